//! Bounds-checked reading of accessors.
//!
//! It covers all component types, normalized integers, interleaving, sparse substitution, and accessors without a
//! buffer view (zeros). Every extent is checked against the bytes at hand before memory is allocated.

use bytes::Bytes;

use super::asset::Asset;
use super::schema::{Accessor, Root, Sparse};
use crate::Error;

/// Reads the accessors of one file.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a> {
    pub(super) asset: Asset<'a>,
    pub(super) root: &'a Root<'a>,
    pub(super) buffers: &'a [Bytes],
}

/// The type of an accessor's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    pub(super) fn of(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    /// Bytes of one number.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    /// The component at the start of `bytes` as a number; normalized integers map to 0..1 or -1..1.
    fn float(self, bytes: &[u8], normalized: bool) -> f32 {
        let scaled = |value: f32, max: f32| if normalized { (value / max).max(-1.0) } else { value };
        match self {
            Self::I8 => scaled(f32::from(bytes[0] as i8), 127.0),
            Self::U8 => scaled(f32::from(bytes[0]), 255.0),
            Self::I16 => scaled(f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
            Self::U16 => scaled(f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
            Self::U32 => scaled(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as f32, u32::MAX as f32),
            Self::F32 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        }
    }

    /// The component at the start of `bytes` as an index; only for unsigned types.
    fn index(self, bytes: &[u8]) -> u32 {
        match self {
            Self::U8 => u32::from(bytes[0]),
            Self::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        }
    }
}

/// Position of equal elements in a buffer view, before it is checked.
struct Layout {
    view: usize,
    /// Bytes from the start of the view.
    offset: usize,
    /// Bytes from one element to the next; tightly packed if `None`.
    stride: Option<usize>,
    /// Bytes of one element.
    size: usize,
    count: usize,
}

/// Equal elements at equal distances; `bytes` ends with the last one.
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Strided<'a> {
    fn get(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..][..self.size]
    }
}

/// The bytes of an accessor's elements, substitutions included.
struct Elements<'a> {
    /// `None` if the accessor has no buffer view: zeros.
    base: Option<Strided<'a>>,
    /// Elements and their replacements, ascending.
    sparse: Vec<(u32, &'a [u8])>,
}

impl<'a> Elements<'a> {
    fn get(&self, index: u32) -> &'a [u8] {
        let last = self.sparse.partition_point(|(at, _)| *at <= index);
        match last.checked_sub(1).map(|last| self.sparse[last]) {
            Some((at, bytes)) if at == index => bytes,
            _ => self.base.as_ref().map_or(&[0; 64], |base| base.get(index as usize)),
        }
    }
}

impl<'a> Reader<'a> {
    /// Number of elements.
    pub(super) fn count(&self, index: usize) -> Result<usize, Error> {
        self.accessor(index).map(|accessor| accessor.count)
    }

    /// Number of components per element.
    pub(super) fn components(&self, index: usize) -> Result<usize, Error> {
        Ok(match self.accessor(index)?.shape {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            other => return Err(self.asset.invalid(format!("accessor {index} has the unexpected type '{other}'"))),
        })
    }

    /// The elements `at` of accessor `index` as floats. Integers are scaled if the accessor is normalized.
    pub(super) fn floats<const N: usize>(
        &self,
        index: usize,
        at: impl Iterator<Item = u32>,
    ) -> Result<Vec<[f32; N]>, Error> {
        let normalized = self.accessor(index)?.normalized;
        self.elements(index, at, |component, bytes| component.float(bytes, normalized))
    }

    /// As [`Self::floats`], but integers are always scaled.
    pub(super) fn normalized<const N: usize>(
        &self,
        index: usize,
        at: impl Iterator<Item = u32>,
    ) -> Result<Vec<[f32; N]>, Error> {
        self.elements(index, at, |component, bytes| component.float(bytes, true))
    }

    /// The elements `at` of accessor `index`, which must hold unsigned integers.
    pub(super) fn integers<const N: usize>(
        &self,
        index: usize,
        at: impl Iterator<Item = u32>,
    ) -> Result<Vec<[u32; N]>, Error> {
        if !self.component(index, self.accessor(index)?.component_type)?.is_index() {
            return Err(self.asset.invalid(format!("accessor {index} holds no unsigned integers")));
        }
        self.elements(index, at, Component::index)
    }

    /// The bytes of a buffer view.
    pub(super) fn view_bytes(&self, index: usize) -> Result<Bytes, Error> {
        let view = self.asset.item(&self.root.buffer_views, index, "buffer view")?;
        let buffer = self.asset.item(self.buffers, view.buffer, "buffer")?;
        match view.byte_offset.checked_add(view.byte_length) {
            Some(end) if end <= buffer.len() => Ok(buffer.slice(view.byte_offset..end)),
            _ => Err(self.asset.invalid(format!("buffer view {index} goes past the end of its buffer"))),
        }
    }

    fn elements<const N: usize, T>(
        &self,
        index: usize,
        at: impl Iterator<Item = u32>,
        convert: impl Fn(Component, &[u8]) -> T,
    ) -> Result<Vec<[T; N]>, Error> {
        let accessor = self.accessor(index)?;
        if self.components(index)? != N {
            let shape = accessor.shape;
            return Err(self.asset.invalid(format!("accessor {index} is a {shape}, where {N} components are needed")));
        }
        let component = self.component(index, accessor.component_type)?;
        let elements = self.bytes(index, accessor, N * component.size())?;
        at.map(|at| {
            if at as usize >= accessor.count {
                let count = accessor.count;
                return Err(self.asset.invalid(format!("element {at} of accessor {index} is used, which has {count}")));
            }
            let bytes = elements.get(at);
            Ok(std::array::from_fn(|k| convert(component, &bytes[k * component.size()..])))
        })
        .collect()
    }

    fn bytes(&self, index: usize, accessor: &Accessor<'_>, size: usize) -> Result<Elements<'a>, Error> {
        let base = match accessor.buffer_view {
            Some(view) => {
                let stride = self.asset.item(&self.root.buffer_views, view, "buffer view")?.byte_stride;
                let (offset, count) = (accessor.byte_offset, accessor.count);
                Some(self.strided(index, &Layout { view, offset, stride, size, count })?)
            }
            None => None,
        };
        let mut out = Elements { base, sparse: Vec::new() };
        if let Some(Sparse { count, indices, values }) = &accessor.sparse {
            let code = self.component(index, indices.component_type)?;
            if !code.is_index() {
                return Err(self.asset.invalid(format!("the sparse indices of accessor {index} are signed")));
            }
            let packed = |view, offset, size| Layout { view, offset, stride: None, size, count: *count };
            let at = self.strided(index, &packed(indices.buffer_view, indices.byte_offset, code.size()))?;
            let values = self.strided(index, &packed(values.buffer_view, values.byte_offset, size))?;
            out.sparse = (0..*count).map(|k| (code.index(at.get(k)), values.get(k))).collect();
            out.sparse.sort_by_key(|(at, _)| *at);
        }
        Ok(out)
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor<'a>, Error> {
        let accessor = self.asset.item(&self.root.accessors, index, "accessor")?;
        // A mesh within the limit on triangles has no more corners than this.
        let most = self.asset.limits.triangles.saturating_mul(3).min(u64::from(u32::MAX));
        self.asset.within(&format!("the element count of accessor {index}"), accessor.count, most)?;
        Ok(accessor)
    }

    fn component(&self, index: usize, code: u32) -> Result<Component, Error> {
        Component::of(code)
            .ok_or_else(|| self.asset.invalid(format!("accessor {index} has the unknown component type {code}")))
    }

    /// Elements of `accessor`, once their extent was checked.
    fn strided(&self, accessor: usize, layout: &Layout) -> Result<Strided<'a>, Error> {
        let &Layout { view: view_index, offset, stride, size, count } = layout;
        let view = self.asset.item(&self.root.buffer_views, view_index, "buffer view")?;
        let buffer = self.asset.item(self.buffers, view.buffer, "buffer")?;
        let end = view.byte_offset.checked_add(view.byte_length);
        let in_view = end
            .and_then(|end| buffer.get(view.byte_offset..end))
            .ok_or_else(|| self.asset.invalid(format!("buffer view {view_index} goes past the end of its buffer")))?;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(self.asset.invalid(format!(
                "buffer view {view_index} has a byteStride of {stride}, less than the {size} bytes of an element"
            )));
        }
        let needed = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        match needed.and_then(|needed| in_view.get(offset..)?.get(..needed)) {
            Some(bytes) => Ok(Strided { bytes, stride, size }),
            None => Err(self.asset.invalid(format!(
                "accessor {accessor} needs {count} elements of {size} bytes from byte {offset} of buffer view \
                 {view_index}, which holds {} bytes",
                view.byte_length
            ))),
        }
    }
}
