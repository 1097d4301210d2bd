//! Decoded geometry in place of the compressed one.

use std::collections::BTreeSet;

use bytes::Bytes;
use serde_json::{Value, json};

use super::decode::{Decoded, NAME, TRIANGLE_STRIP, TRIANGLES};
use super::geometry::{Attribute, Geometry};
use crate::gltf::import::extensions;
use crate::gltf::rewrite::{Rewrite, ViewUse};

/// glTF's code of floats.
const FLOAT: u32 = 5126;
/// The most vertices that indices of 16 bits can count: the last number restarts a primitive.
const MAX_U16_VERTICES: usize = u16::MAX as usize;

/// Writes `decoded` into the document, and removes the extension from it.
pub(in crate::gltf::import) fn replace(json: &mut Value, buffers: &mut Vec<Bytes>, decoded: &[Decoded]) {
    let mut writer = Writer { rewrite: Rewrite::new(json, buffers), claimed: BTreeSet::new() };
    for item in decoded {
        let indices = writer.indices(item.view, item.indices, &item.geometry);
        let attributes: Vec<(&str, usize)> = item
            .attributes
            .iter()
            .zip(&item.geometry.attributes)
            .map(|((name, accessor), attribute)| {
                (name.as_str(), writer.attribute(*accessor, item.geometry.vertices, attribute))
            })
            .collect();
        for &place in &item.places {
            point(writer.rewrite.json, place, indices, &attributes);
        }
    }
    writer.rewrite.finish();
    extensions::undeclare(json, "extensionsRequired", &[NAME]);
    let primitives = json["meshes"].as_array().into_iter().flatten().filter_map(|mesh| mesh["primitives"].as_array());
    if !primitives.flatten().any(|primitive| primitive["extensions"].get(NAME).is_some()) {
        extensions::undeclare(json, "extensionsUsed", &[NAME]);
    }
}

struct Writer<'a> {
    rewrite: Rewrite<'a>,
    /// Accessors that describe decoded data.
    claimed: BTreeSet<usize>,
}

impl Writer<'_> {
    /// Writes the indices in place of the compressed bytes; returns their accessor.
    fn indices(&mut self, view: usize, accessor: Option<usize>, geometry: &Geometry) -> usize {
        let is_short = geometry.vertices <= MAX_U16_VERTICES;
        let bytes: Vec<u8> = match is_short {
            true => geometry.indices.iter().flat_map(|&index| (index as u16).to_le_bytes()).collect(),
            false => geometry.indices.iter().flat_map(|index| index.to_le_bytes()).collect(),
        };
        let view = self.rewrite.replace_view(view, &bytes, ViewUse::Indices);
        let component = if is_short { 5123 } else { 5125 };
        let properties = json!({ "bufferView": view, "componentType": component, "count": geometry.indices.len(),
            "type": "SCALAR" });
        self.accessor(accessor, properties)
    }

    /// Writes an attribute of `vertices` vertices; returns its accessor.
    fn attribute(&mut self, accessor: usize, vertices: usize, attribute: &Attribute) -> usize {
        let view = self.rewrite.push_view(&attribute.bytes, ViewUse::Vertices { stride: attribute.stride });
        let accessor =
            self.accessor(Some(accessor), json!({ "bufferView": view, "count": vertices, "type": attribute.shape }));
        set_bounds(&mut self.rewrite.list("accessors")[accessor], attribute);
        accessor
    }

    /// Gives an accessor the `properties`. One that describes other data stays, and a copy of it gets them.
    fn accessor(&mut self, accessor: Option<usize>, properties: Value) -> usize {
        let accessors = self.rewrite.list("accessors");
        let old = accessor.and_then(|index| accessors.get(index));
        let mut new = old.cloned().unwrap_or_else(|| json!({}));
        let is_free = old.is_some_and(|old| old.get("bufferView").is_none() && old.get("sparse").is_none());
        for key in ["byteOffset", "sparse"] {
            new.as_object_mut().and_then(|object| object.remove(key));
        }
        if let (Some(new), Value::Object(properties)) = (new.as_object_mut(), properties) {
            new.extend(properties);
        }
        match accessor.filter(|index| is_free && self.claimed.insert(*index)) {
            Some(index) => {
                accessors[index] = new;
                index
            }
            None => {
                accessors.push(new);
                accessors.len() - 1
            }
        }
    }
}

/// Makes the bounds of an accessor of floats, if it has any, those of the decoded data: the compression rounds.
fn set_bounds(accessor: &mut Value, attribute: &Attribute) {
    if accessor.get("min").is_none() || accessor["componentType"] != FLOAT {
        return;
    }
    let components = accessor["min"].as_array().map_or(0, Vec::len);
    let (mut low, mut high) = (vec![f32::INFINITY; components], vec![f32::NEG_INFINITY; components]);
    for element in attribute.bytes.chunks_exact(attribute.stride) {
        let numbers = element.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        for ((low, high), x) in low.iter_mut().zip(&mut high).zip(numbers) {
            (*low, *high) = (low.min(x), high.max(x));
        }
    }
    if low.iter().chain(&high).all(|x| x.is_finite()) {
        (accessor["min"], accessor["max"]) = (json!(low), json!(high));
    }
}

/// Points a primitive at decoded data.
fn point(json: &mut Value, (mesh, primitive): (usize, usize), indices: usize, attributes: &[(&str, usize)]) {
    let Some(primitive) = json.pointer_mut(&format!("/meshes/{mesh}/primitives/{primitive}")) else { return };
    extensions::take(primitive, &[NAME]);
    primitive["indices"] = json!(indices);
    for (name, accessor) in attributes {
        primitive["attributes"][*name] = json!(accessor);
    }
    // The decoded indices are those of a list of triangles.
    if primitive["mode"] == TRIANGLE_STRIP {
        primitive["mode"] = json!(TRIANGLES);
    }
}
