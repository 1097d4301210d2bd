//! A part of a document: some of its nodes alone, on the joints and the clips of all.

use std::collections::BTreeSet;

use bytes::Bytes;
use serde_json::{Value, json};
use simpliguard::data::{Document, Model};
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::{Error, RelativeUri, Resources, Source, StageId};

use super::nodes::{below, scene_roots, stamp};
use crate::inspect::document::{INSTANCING, index};

/// Properties of a node that place it below its parent.
const TRANSFORM: [&str; 4] = ["matrix", "translation", "rotation", "scale"];
/// Folders of the files that a part refers to: a number in them is that of a buffer or an image of the document.
const BUFFERS: &str = "buffers";
const IMAGES: &str = "images";

/// How often the nodes of a part are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instances {
    /// As the file says.
    All,
    /// Once, without `EXT_mesh_gpu_instancing`.
    One,
}

/// Some nodes of a document.
#[derive(Clone, Copy)]
pub(crate) struct Part<'a> {
    pub(crate) document: &'a Document,
    /// Those that keep their meshes.
    pub(crate) nodes: &'a [usize],
    pub(crate) drawn: Instances,
}

impl Part<'_> {
    /// Reads the part as a model of its own. `name` is for messages.
    ///
    /// # Errors
    /// Those of the import.
    pub(crate) fn import(&self, name: &str) -> Result<Model, Error> {
        let json = self.json().ok_or_else(|| {
            Error::invalid(name, StageId::Import, "its document has no nodes", "check it with glTF-Validator")
        })?;
        let (bytes, resources) = (json.to_string().into_bytes(), Files(self.document));
        import(&Source { name, bytes: &bytes, resources: &resources }, &ImportLimits::default())
    }

    /// The document with these nodes as the only ones with meshes. What it refers to are files.
    fn json(&self) -> Option<Value> {
        let mut json = self.document.json.clone();
        let kept: BTreeSet<usize> = self.nodes.iter().copied().collect();
        for (i, node) in json.get_mut("nodes")?.as_array_mut()?.iter_mut().enumerate() {
            let node = node.as_object_mut()?;
            if !kept.contains(&i) {
                node.remove("mesh");
                node.remove("skin");
            } else if let (Instances::One, Some(extensions)) = (self.drawn, node.get_mut("extensions")) {
                extensions.as_object_mut()?.remove(INSTANCING);
            }
        }
        let roots = attach(&mut json, self.nodes)?;
        json["scenes"] = json!([{ "nodes": roots }]);
        json["scene"] = 0.into();
        self.refer_to_files(&mut json);
        Some(json)
    }

    /// Gives all bytes that were read a URI.
    fn refer_to_files(&self, json: &mut Value) {
        let mut refer = |list: &str, i: usize| {
            if let Some(item) = json.get_mut(list).and_then(|items| items.get_mut(i)) {
                item["uri"] = format!("{list}/{i}").into();
            }
        };
        let read = self.document.buffers.iter().enumerate().filter(|(_, bytes)| !bytes.is_empty());
        read.for_each(|(i, _)| refer(BUFFERS, i));
        let read = self.document.images.iter().enumerate().filter(|(_, image)| image.is_some());
        read.for_each(|(i, _)| refer(IMAGES, i));
    }
}

/// Hangs those of `nodes` that stand outside the default scene into it: a level into the space that it lies in, so that it
/// follows its object, and others at the root. Returns the roots. `None` of a document without nodes.
pub(crate) fn attach(json: &mut Value, nodes: &[usize]) -> Option<Vec<usize>> {
    let mut roots = scene_roots(json);
    let inside = below(json, &roots);
    let all = json.get_mut("nodes")?.as_array_mut()?;
    for &node in nodes.iter().filter(|node| !inside.contains(node)) {
        // The joints place a skinned level, whatever it hangs on.
        let space =
            all.get(node).filter(|node| node.get("skin").is_none()).and_then(|node| index(stamp(node)?, "space"));
        match space.filter(|space| inside.contains(space) && *space < all.len()) {
            Some(space) => {
                let level = all[node].as_object_mut()?;
                TRANSFORM.iter().for_each(|key| drop(level.remove(*key)));
                all[space]
                    .as_object_mut()?
                    .entry("children")
                    .or_insert_with(|| json!([]))
                    .as_array_mut()?
                    .push(node.into());
            }
            None => roots.push(node),
        }
    }
    Some(roots)
}

/// The buffers and images of a document as files.
struct Files<'a>(&'a Document);

impl Resources for Files<'_> {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        let number = |folder: &str| uri.as_str().strip_prefix(folder)?.strip_prefix('/')?.parse::<usize>().ok();
        let buffer = number(BUFFERS).and_then(|i| self.0.buffers.get(i));
        let image = || Some(&self.0.images.get(number(IMAGES)?)?.as_ref()?.0);
        buffer.or_else(image).cloned().ok_or_else(|| "the document was read without it".to_owned())
    }
}
