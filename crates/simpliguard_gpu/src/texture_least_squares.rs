//! The texture that fits the views best, for fixed vertices: the normal equations on the device, solved by conjugate
//! gradients. The method is that of `refine/texture_least_squares` of the pipeline.

use glam::Vec4;
use simpliguard::refine::TexelGrid;
use simpliguard::render::fill_unknown;
use wgpu::{Buffer, ComputePass};

use crate::device::GpuDevice;
use crate::error::GpuError;
use crate::frame::VECTOR;
use crate::kernels::{Bindings, Slot, groups};

/// Texels of a workgroup.
const PER_GROUP: usize = 256;
/// Bytes of the sums over pixels, for each texel.
pub(crate) const SUMS: usize = 4 * VECTOR;

/// Buffers of the equations of a texture.
pub(crate) struct TextureSolver {
    texels: usize,
    buffers: Vec<(Slot, Buffer)>,
    solution: Buffer,
}

impl TextureSolver {
    /// For a texture of `size` x `size` texels.
    pub(crate) fn new(gpu: &GpuDevice, size: usize) -> Result<Self, GpuError> {
        let texels = size * size;
        let [columns, rows] = groups(texels, PER_GROUP);
        let buffer = |slot, what, bytes| Ok::<_, GpuError>((slot, gpu.buffer(what, bytes)?));
        let buffers = vec![
            buffer(Slot::PixelSums, "the sums over pixels", SUMS * texels)?,
            buffer(Slot::Rows, "the normal equations", 2 * VECTOR * texels)?,
            buffer(Slot::Remainder, "the residual of the texture", VECTOR * texels)?,
            buffer(Slot::Scaled, "the scaled residual", VECTOR * texels)?,
            buffer(Slot::Heading, "the direction", VECTOR * texels)?,
            buffer(Slot::Product, "the product", VECTOR * texels)?,
            buffer(Slot::Partials, "the partial sums of the texture", VECTOR * (columns * rows) as usize)?,
            buffer(Slot::Iteration, "the state of the iteration", 4 * VECTOR)?,
        ];
        let solution = gpu.buffer("the solution", VECTOR * texels)?;
        Ok(Self { texels, buffers, solution })
    }

    pub(crate) fn bindings(&self) -> impl Iterator<Item = (Slot, &Buffer)> {
        let own = self.buffers.iter().map(|(slot, buffer)| (*slot, buffer));
        own.chain([(Slot::Solution, &self.solution)])
    }

    /// The buffer with the solution, and its size.
    pub(crate) fn solution(&self) -> (&Buffer, usize) {
        (&self.solution, VECTOR * self.texels)
    }

    /// Begins without any pixel.
    pub(crate) fn clear(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        gpu.kernels.clear_sums.run(pass, &gpu.device, bindings, groups(self.texels, PER_GROUP));
    }

    /// Begins to solve the equations of all pixels so far.
    pub(crate) fn begin(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        let (device, kernels, all) = (&gpu.device, &gpu.kernels, groups(self.texels, PER_GROUP));
        kernels.regularise.run(pass, device, bindings, all);
        kernels.begin_descent.run(pass, device, bindings, all);
        kernels.first_energy.run(pass, device, bindings, [1, 1]);
        kernels.turn.run(pass, device, bindings, all);
    }

    /// Some iterations. Steps after the last needed one have no length.
    pub(crate) fn go_on(
        &self,
        gpu: &GpuDevice,
        pass: &mut ComputePass<'_>,
        bindings: &Bindings<'_>,
        iterations: usize,
    ) {
        let (device, kernels, all) = (&gpu.device, &gpu.kernels, groups(self.texels, PER_GROUP));
        for _ in 0..iterations {
            kernels.multiply.run(pass, device, bindings, all);
            kernels.step_length.run(pass, device, bindings, [1, 1]);
            kernels.step_solution.run(pass, device, bindings, all);
            kernels.next_factor.run(pass, device, bindings, [1, 1]);
            kernels.turn.run(pass, device, bindings, all);
        }
    }

    /// Replaces a texture by the solution. Texels that neither a triangle covers nor a view sees take those around them.
    pub(crate) fn take(&self, solution: &[u8], texture: &mut TexelGrid) {
        let solution: Vec<Vec4> = bytemuck::pod_collect_to_vec(solution);
        let TexelGrid { size, texels, covered, .. } = texture;
        let known: Vec<bool> = covered.iter().zip(&solution).map(|(covered, x)| *covered || x.w > 0.5).collect();
        let clamped = |x: &Vec4| x.clamp(Vec4::ZERO, Vec4::ONE).with_w(1.0);
        texels.iter_mut().zip(&solution).for_each(|(texel, x)| *texel = clamped(x));
        fill_unknown(texels, &known, *size);
    }
}
