//! Accessors of a glTF as plain arrays.

use serde_json::Value;
use simpliguard::data::Document;

use crate::inspect::document::index;

/// Component types of 32-bit floats and of 16-bit numbers.
const FLOAT: u64 = 5126;
const UNSIGNED_SHORT: u64 = 5123;

/// The elements of an accessor, without gaps between them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Array {
    /// The accessor without its buffer view, offsets and sparse elements.
    pub(super) json: Value,
    pub(super) bytes: Vec<u8>,
    /// Bytes of an element.
    pub(super) size: usize,
}

impl Array {
    /// Reads an accessor, with its sparse elements in place. `None` if it is not as the specification asks.
    pub(super) fn read(document: &Document, accessor: usize) -> Option<Self> {
        let json = document.json.get("accessors")?.get(accessor)?;
        let size = components(json)? * component_bytes(json)?;
        let count = index(json, "count")?;
        let mut bytes = match index(json, "bufferView") {
            Some(_) => gather(document, json, size, count)?,
            None => vec![0; size.checked_mul(count)?],
        };
        if let Some(sparse) = json.get("sparse") {
            lay_sparse(document, sparse, size, &mut bytes)?;
        }
        let mut json = json.clone();
        for field in ["bufferView", "byteOffset", "sparse"] {
            json.as_object_mut()?.remove(field);
        }
        Some(Self { json, bytes, size })
    }

    /// The elements with these indices; `None` if one is out of range.
    pub(super) fn subset(&self, elements: &[u32]) -> Option<Self> {
        let mut bytes = Vec::with_capacity(elements.len() * self.size);
        for &element in elements {
            let start = element as usize * self.size;
            bytes.extend(self.bytes.get(start..start + self.size)?);
        }
        let mut json = self.json.clone();
        json.as_object_mut()?.insert("count".into(), elements.len().into());
        Some(Self { json, bytes, size: self.size })
    }

    /// The components as floats; `None` if they are of another type.
    pub(super) fn floats(&self) -> Option<Vec<f32>> {
        (self.json.get("componentType")?.as_u64()? == FLOAT).then_some(())?;
        Some(self.bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    /// Floats from 0 to 1 in half the bytes, normalised; others as they are.
    pub(super) fn narrowed(self) -> Self {
        let Some(floats) = self.floats().filter(|floats| floats.iter().all(|x| (0.0..=1.0).contains(x))) else {
            return self;
        };
        let short = |x: f32| ((x * f32::from(u16::MAX)).round() as u16).to_le_bytes();
        let bytes = floats.into_iter().flat_map(short).collect();
        let mut json = self.json;
        json["componentType"] = UNSIGNED_SHORT.into();
        json["normalized"] = true.into();
        for bound in ["min", "max"] {
            json.as_object_mut().map(|json| json.remove(bound));
        }
        Self { json, bytes, size: self.size / 2 }
    }

    /// Positions as floats; `None` if they are of another type.
    pub(super) fn positions(&self) -> Option<Vec<[f32; 3]>> {
        (self.size == 12).then_some(())?;
        Some(self.floats()?.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect())
    }

    /// Indices of any width; `None` if it is no list of them.
    pub(super) fn indices(&self) -> Option<Vec<u32>> {
        (1..=4).contains(&self.size).then_some(())?;
        let number = |b: &[u8]| b.iter().rev().fold(0, |n, &byte| n << 8 | u32::from(byte));
        Some(self.bytes.chunks_exact(self.size).map(number).collect())
    }

    /// Indices as an array, each as narrow as they allow.
    pub(super) fn of_indices(indices: &[u32]) -> Self {
        let is_short = indices.iter().all(|&i| i < u32::from(u16::MAX));
        let (kind, size) = if is_short { (UNSIGNED_SHORT, 2) } else { (5125, 4) };
        let bytes = indices.iter().flat_map(|i| i.to_le_bytes().into_iter().take(size)).collect();
        let json = serde_json::json!({"componentType": kind, "type": "SCALAR", "count": indices.len()});
        Self { json, bytes, size }
    }
}

/// The elements of an accessor or of a part of a sparse one, from its buffer view.
fn gather(document: &Document, json: &Value, size: usize, count: usize) -> Option<Vec<u8>> {
    let view = document.json.get("bufferViews")?.get(index(json, "bufferView")?)?;
    let buffer = document.buffers.get(index(view, "buffer")?)?;
    let start = index(view, "byteOffset").unwrap_or(0).checked_add(index(json, "byteOffset").unwrap_or(0))?;
    let stride = index(view, "byteStride").unwrap_or(size);
    let mut bytes = Vec::new();
    for i in 0..count {
        let at = start.checked_add(i.checked_mul(stride)?)?;
        bytes.extend(buffer.get(at..at.checked_add(size)?)?);
    }
    Some(bytes)
}

fn lay_sparse(document: &Document, sparse: &Value, size: usize, bytes: &mut [u8]) -> Option<()> {
    let count = index(sparse, "count")?;
    let [places, values] = ["indices", "values"].map(|part| sparse.get(part));
    let (places, width) = (places?, component_bytes(places?)?);
    let places = gather(document, places, width, count)?;
    let values = gather(document, values?, size, count)?;
    for (place, value) in places.chunks_exact(width).zip(values.chunks_exact(size)) {
        let start = place.iter().rev().fold(0, |n, &byte| n << 8 | usize::from(byte)).checked_mul(size)?;
        bytes.get_mut(start..start.checked_add(size)?)?.copy_from_slice(value);
    }
    Some(())
}

fn components(json: &Value) -> Option<usize> {
    Some(match json.get("type")?.as_str()? {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => return None,
    })
}

fn component_bytes(json: &Value) -> Option<usize> {
    Some(match json.get("componentType")?.as_u64()? {
        5120 | 5121 => 1,
        5122 | UNSIGNED_SHORT => 2,
        5125 | FLOAT => 4,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn document(bytes: Vec<u8>, json: Value) -> Document {
        Document { json, buffers: vec![bytes.into()], ..Document::default() }
    }

    #[test]
    fn interleaved_and_sparse_elements_are_laid_side_by_side() {
        let document = document(
            vec![1, 0, 9, 9, 2, 0, 9, 9, 3, 0, 9, 9, 1, 0, 7, 0],
            json!({
                "bufferViews": [{"buffer": 0, "byteLength": 12, "byteStride": 4}, {"buffer": 0, "byteOffset": 12}],
                "accessors": [
                    {"bufferView": 0, "componentType": 5123, "type": "SCALAR", "count": 3, "sparse": {
                        "count": 1, "indices": {"bufferView": 1, "componentType": 5121},
                        "values": {"bufferView": 1, "byteOffset": 2, "componentType": 5123}}},
                    {"bufferView": 0, "componentType": 5123, "type": "SCALAR", "count": 9},
                ],
            }),
        );
        let array = Array::read(&document, 0).expect("an accessor");
        assert_eq!(array.indices(), Some(vec![1, 7, 3]));
        assert_eq!(array.json, json!({"componentType": 5123, "type": "SCALAR", "count": 3}));
        assert_eq!(array.subset(&[2, 0]).and_then(|subset| subset.indices()), Some(vec![3, 1]));
        assert!(array.subset(&[3]).is_none());
        assert!(Array::read(&document, 1).is_none() && Array::read(&document, 2).is_none());
    }

    #[test]
    fn floats_from_0_to_1_are_narrowed_and_others_are_not() {
        let array = |floats: [f32; 2]| Array {
            json: json!({"componentType": 5126, "type": "VEC2", "count": 1, "max": floats}),
            bytes: floats.iter().flat_map(|x| x.to_le_bytes()).collect(),
            size: 8,
        };
        let narrow = array([0.0, 1.0]).narrowed();
        assert_eq!(narrow.json, json!({"componentType": 5123, "type": "VEC2", "count": 1, "normalized": true}));
        assert_eq!((narrow.bytes, narrow.size), (vec![0, 0, 255, 255], 4));
        assert_eq!(array([0.5, 1.5]).narrowed(), array([0.5, 1.5]));
    }

    #[test]
    fn indices_are_as_narrow_as_they_allow() {
        for (indices, size) in [(vec![0, 1, 65534], 2), (vec![0, 65535], 4)] {
            let array = Array::of_indices(&indices);
            assert_eq!((array.size, array.indices()), (size, Some(indices)));
        }
    }
}
