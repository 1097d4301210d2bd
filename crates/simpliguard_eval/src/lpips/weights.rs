//! The file of weights: the state of the Python module `lpips.LPIPS(net="squeeze")` as safetensors.

use safetensors::{Dtype, SafeTensors};

use super::convolution::{Convolution, Shape};

/// The weights of LPIPS cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {problem}; docs/command.md has the command that makes the file")]
pub struct LpipsError {
    /// The file of weights.
    pub(super) file: String,
    pub(super) problem: String,
}

/// The tensors of a file.
pub(super) struct Tensors<'a> {
    tensors: SafeTensors<'a>,
}

impl<'a> Tensors<'a> {
    /// Reads the head of a file.
    ///
    /// # Errors
    /// What is wrong with the file, in words.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, String> {
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| format!("it is no safetensors file: {error}"))?;
        Ok(Self { tensors })
    }

    /// The convolution whose weights begin with this name.
    ///
    /// # Errors
    /// If its tensors are missing or have another shape.
    pub(super) fn convolution(&self, name: &str, shape: Shape) -> Result<Convolution, String> {
        let Shape { channels: [inputs, outputs], kernel, .. } = shape;
        let weights = self.numbers(&format!("{name}.weight"), &[outputs, inputs, kernel, kernel])?;
        let bias = self.numbers(&format!("{name}.bias"), &[outputs])?;
        Ok(Convolution::new(shape, &weights, &bias))
    }

    /// A tensor of this shape.
    ///
    /// # Errors
    /// If it is missing, has another shape or type, or holds what is no number.
    pub(super) fn numbers(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, String> {
        let tensor = self.tensors.tensor(name).map_err(|_| format!("it has no tensor '{name}'"))?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            let (kind, found) = (tensor.dtype(), tensor.shape());
            return Err(format!("tensor '{name}' is {kind:?} {found:?}, not F32 {shape:?}"));
        }
        let numbers: Vec<f32> = tensor.data().as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        if numbers.iter().all(|number| number.is_finite()) {
            Ok(numbers)
        } else {
            Err(format!("tensor '{name}' holds what is no number"))
        }
    }
}
