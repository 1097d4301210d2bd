//! A glTF written anew: only what its scene shows.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};
use simpliguard::data::Document;
use simpliguard::gltf::binary;

use super::arrays::Array;
use super::decimate::compact;
use crate::inspect::document::index;

/// Vertex attributes of a decimated source that are kept: what a viewer without its second set of texture coordinates shows.
const KEPT: [&str; 9] =
    ["POSITION", "NORMAL", "TEXCOORD_0", "TEXCOORD_1", "COLOR_0", "JOINTS_0", "WEIGHTS_0", "JOINTS_1", "WEIGHTS_1"];
/// Beginnings of the names of those that a glTF may have as normalised 16-bit numbers.
const MAY_BE_SHORT: [&str; 3] = ["TEXCOORD_", "COLOR_", "WEIGHTS_"];

/// The accessors and the binary data of a new file.
pub(super) struct Writer<'a> {
    document: &'a Document,
    accessors: Vec<Value>,
    views: Vec<Value>,
    binary: Vec<u8>,
    /// New indices of accessors that are copied as they are.
    copied: BTreeMap<usize, Option<usize>>,
}

impl<'a> Writer<'a> {
    pub(super) fn new(document: &'a Document) -> Self {
        Self { document, accessors: Vec::new(), views: Vec::new(), binary: Vec::new(), copied: BTreeMap::new() }
    }

    /// Adds bytes as a buffer view. Returns its index.
    pub(super) fn view(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()}));
        self.binary.extend(bytes);
        self.views.len() - 1
    }

    /// Adds an accessor. Vertices are padded to whole words, as the specification asks.
    fn array(&mut self, array: &Array, is_vertices: bool) -> usize {
        let stride = array.size.next_multiple_of(4);
        let view = if is_vertices && stride != array.size {
            let pad =
                |element: &[u8]| element.iter().copied().chain(vec![0; stride - element.len()]).collect::<Vec<_>>();
            let padded: Vec<u8> = array.bytes.chunks_exact(array.size).flat_map(pad).collect();
            let view = self.view(&padded);
            self.views[view]["byteStride"] = stride.into();
            view
        } else {
            self.view(&array.bytes)
        };
        let mut json = array.json.clone();
        json["bufferView"] = view.into();
        self.accessors.push(json);
        self.accessors.len() - 1
    }

    /// Copies an accessor once. `None` if it cannot be read.
    fn copy(&mut self, accessor: usize, is_vertices: bool) -> Option<usize> {
        if let Some(copied) = self.copied.get(&accessor) {
            return *copied;
        }
        let copied = Array::read(self.document, accessor).map(|array| self.array(&array, is_vertices));
        self.copied.insert(accessor, copied);
        copied
    }

    /// Replaces every index in an object by that of the copied accessor.
    fn copy_all(&mut self, indices: &mut Map<String, Value>, is_vertices: bool) -> Option<()> {
        for value in indices.values_mut() {
            *value = self.copy(usize::try_from(value.as_u64()?).ok()?, is_vertices)?.into();
        }
        Some(())
    }

    /// Replaces the index in a field by that of the copied accessor.
    fn copy_field(&mut self, object: &mut Value, field: &str) -> Option<()> {
        if let Some(accessor) = index(object, field) {
            object[field] = self.copy(accessor, false)?.into();
        }
        Some(())
    }

    /// Copies a primitive as it is. `None` if it cannot be read.
    pub(super) fn primitive(&mut self, primitive: &mut Value) -> Option<()> {
        self.copy_all(primitive.get_mut("attributes")?.as_object_mut()?, true)?;
        for target in primitive.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
            self.copy_all(target.as_object_mut()?, true)?;
        }
        self.copy_field(primitive, "indices")
    }

    /// Copies a primitive with some of its triangles alone. `None` if it cannot be read.
    pub(super) fn decimated(&mut self, primitive: &mut Value, indices: &[u32]) -> Option<()> {
        let (kept, indices) = compact(indices);
        let attributes = primitive.get_mut("attributes")?.as_object_mut()?;
        attributes.retain(|name, _| KEPT.contains(&name.as_str()));
        for (name, value) in attributes {
            let subset = self.subset(value, &kept)?;
            let may_be_short = MAY_BE_SHORT.iter().any(|prefix| name.starts_with(prefix));
            *value = self.array(&if may_be_short { subset.narrowed() } else { subset }, true).into();
        }
        for target in primitive.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
            let target = target.as_object_mut()?;
            target.retain(|name, _| KEPT.contains(&name.as_str()));
            for value in target.values_mut() {
                let subset = self.subset(value, &kept)?;
                *value = self.array(&subset, true).into();
            }
        }
        primitive["indices"] = self.array(&Array::of_indices(&indices), false).into();
        Some(())
    }

    /// Some elements of the accessor with an index.
    fn subset(&self, accessor: &Value, kept: &[u32]) -> Option<Array> {
        Array::read(self.document, usize::try_from(accessor.as_u64()?).ok()?)?.subset(kept)
    }

    /// Copies the matrices of skins. `None` if they cannot be read.
    pub(super) fn skins(&mut self, json: &mut Value, used: &BTreeSet<usize>) -> Option<()> {
        for (i, skin) in json.get_mut("skins").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
            if used.contains(&i) {
                self.copy_field(skin, "inverseBindMatrices")?;
            } else if let Some(skin) = skin.as_object_mut() {
                skin.remove("inverseBindMatrices");
            }
        }
        Some(())
    }

    /// Copies the transforms of instanced nodes. `None` if they cannot be read.
    pub(super) fn instances(&mut self, node: &mut Value) -> Option<()> {
        match node.pointer_mut("/extensions/EXT_mesh_gpu_instancing/attributes") {
            Some(attributes) => self.copy_all(attributes.as_object_mut()?, true),
            None => Some(()),
        }
    }

    /// Copies the channels of clips that move any of `nodes`. `None` if they cannot be read.
    pub(super) fn clips(&mut self, json: &mut Value, nodes: &BTreeSet<usize>) -> Option<()> {
        for clip in json.get_mut("animations").and_then(Value::as_array_mut).into_iter().flatten() {
            let moves = |channel: &Value| {
                channel.get("target").and_then(|target| index(target, "node")).is_some_and(|node| nodes.contains(&node))
            };
            let mut channels = clip.get("channels")?.as_array()?.clone();
            channels.retain(moves);
            let old = clip.get("samplers")?.as_array()?.clone();
            let (mut samplers, mut new) = (Vec::new(), BTreeMap::new());
            for channel in &mut channels {
                let sampler = index(channel, "sampler")?;
                if let Entry::Vacant(entry) = new.entry(sampler) {
                    let mut copy = old.get(sampler)?.clone();
                    self.copy_field(&mut copy, "input")?;
                    self.copy_field(&mut copy, "output")?;
                    entry.insert(samplers.len());
                    samplers.push(copy);
                }
                channel["sampler"] = new[&sampler].into();
            }
            clip["channels"] = channels.into();
            clip["samplers"] = samplers.into();
        }
        let is_empty = |clip: &Value| clip.get("channels").and_then(Value::as_array).is_none_or(Vec::is_empty);
        if let Some(clips) = json.get_mut("animations").and_then(Value::as_array_mut) {
            clips.retain(|clip| !is_empty(clip));
        }
        Some(())
    }

    /// The binary glTF. `None` if it is too large for one.
    pub(super) fn finish(mut self, mut json: Value) -> Option<Vec<u8>> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        json["accessors"] = self.accessors.into();
        json["bufferViews"] = self.views.into();
        json["buffers"] = json!([{"byteLength": self.binary.len()}]);
        // A glTF may not have an empty list.
        json.as_object_mut()?.retain(|_, value| value.as_array().is_none_or(|list| !list.is_empty()));
        binary(&json, &self.binary).ok()
    }
}
