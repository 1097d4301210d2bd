//! The byte ranges of a buffer view that are still used.

use std::ops::Range;

use serde_json::Value;

use super::builder::index;

/// Byte ranges of one buffer view. Each begins at a multiple of four, so that accessors stay aligned when the gaps
/// between ranges are closed.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Ranges {
    whole: bool,
    parts: Vec<Range<usize>>,
}

impl Ranges {
    /// All of the view.
    pub(super) fn whole() -> Self {
        Self { whole: true, parts: Vec::new() }
    }

    /// Adds the bytes of an accessor.
    pub(super) fn add_accessor(&mut self, accessor: &Value, byte_stride: Option<usize>) {
        let (Some(size), Some(count)) = (element_size(accessor), index(accessor, "count")) else {
            self.whole = true;
            return;
        };
        let start = index(accessor, "byteOffset").unwrap_or(0);
        let stride = byte_stride.unwrap_or(size);
        let end = stride.checked_mul(count.saturating_sub(1)).and_then(|n| n.checked_add(start)?.checked_add(size));
        match end {
            Some(end) => self.parts.push(start - start % 4..end),
            None => self.whole = true,
        }
    }

    /// Sorts the ranges, joins those that touch, and extends each to the next multiple of four.
    pub(super) fn merge(&mut self) {
        self.parts.sort_by_key(|r| (r.start, r.end));
        let mut merged: Vec<Range<usize>> = Vec::new();
        for part in self.parts.drain(..) {
            let end = part.end.checked_next_multiple_of(4).unwrap_or(part.end);
            match merged.last_mut() {
                Some(last) if part.start <= last.end => last.end = last.end.max(end),
                _ => merged.push(part.start..end),
            }
        }
        self.parts = merged;
    }

    /// The merged ranges of a view of `length` bytes.
    pub(super) fn within(&self, length: usize) -> Vec<Range<usize>> {
        if self.whole {
            return std::iter::once(0..length).collect();
        }
        self.parts.iter().map(|r| r.start.min(length)..r.end.min(length)).collect()
    }

    /// The new offset of the byte at `offset`, after the gaps are closed.
    pub(super) fn moved(&self, offset: usize) -> usize {
        if self.whole {
            return offset;
        }
        let mut before = 0;
        for part in &self.parts {
            if offset < part.end {
                return before + offset.saturating_sub(part.start);
            }
            before += part.len();
        }
        before
    }
}

/// Bytes of one element of an accessor. Columns of matrices are padded to four bytes.
pub(in crate::gltf) fn element_size(accessor: &Value) -> Option<usize> {
    let component = match index(accessor, "componentType")? {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        5125 | 5126 => 4,
        _ => return None,
    };
    let column = |rows: usize| (rows * component).next_multiple_of(4);
    Some(match accessor.get("type")?.as_str()? {
        "SCALAR" => component,
        "VEC2" => 2 * component,
        "VEC3" => 3 * component,
        "VEC4" => 4 * component,
        "MAT2" => 2 * column(2),
        "MAT3" => 3 * column(3),
        "MAT4" => 4 * column(4),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn shorts(offset: usize, count: usize) -> Value {
        json!({ "byteOffset": offset, "count": count, "componentType": 5123, "type": "SCALAR" })
    }

    #[test]
    fn gaps_close_and_offsets_follow() {
        let mut ranges = Ranges::default();
        ranges.add_accessor(&shorts(40, 3), None);
        ranges.add_accessor(&shorts(8, 4), None);
        ranges.merge();
        assert_eq!(ranges.within(64), [8..16, 40..48]);
        assert_eq!([8, 10, 40, 44].map(|o| ranges.moved(o)), [0, 2, 8, 12]);
    }

    #[test]
    fn interleaved_attributes_stay_together() {
        let mut ranges = Ranges::default();
        let vec3 = |offset: usize| json!({ "byteOffset": offset, "count": 4, "componentType": 5126, "type": "VEC3" });
        ranges.add_accessor(&vec3(0), Some(24));
        ranges.add_accessor(&vec3(12), Some(24));
        ranges.merge();
        assert_eq!(ranges.within(96), std::iter::once(0..96).collect::<Vec<_>>());
        assert_eq!(ranges.moved(12), 12);
    }

    #[test]
    fn columns_of_small_matrices_are_padded() {
        let size = |kind: &str, component: u32| element_size(&json!({ "componentType": component, "type": kind }));
        assert_eq!([size("MAT2", 5121), size("MAT3", 5121), size("MAT3", 5123)], [Some(8), Some(12), Some(24)]);
    }
}
