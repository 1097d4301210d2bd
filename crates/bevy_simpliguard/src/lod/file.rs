//! The levels in a combined file: `MSFT_lod` on one node, and `extras.simpliguard` on the nodes that it lists.

use bevy::log::{debug, warn};
use gltf::json::{Value, deserialize};
use gltf::mesh::Mode;
use serde::Deserialize;

/// The levels of a file, and its document.
pub(super) struct LodFile {
    pub(super) document: gltf::Document,
    /// Index of the node with `MSFT_lod`.
    pub(super) holder: usize,
    /// Indices of the nodes whose meshes the levels stand for.
    pub(super) replaces: Vec<usize>,
    /// The levels in falling detail. Not empty.
    pub(super) levels: Vec<FileLevel>,
}

/// A level, as its node describes it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileLevel {
    pub(super) node: usize,
    pub(super) level: u32,
    pub(super) budget: u32,
    pub(super) faces: u32,
    /// A fraction of the diagonal of the source's bounding box.
    pub(super) error: f32,
}

#[derive(Deserialize)]
struct Extras {
    simpliguard: Stamp,
}

#[derive(Deserialize)]
struct Stamp {
    level: u32,
    budget: u32,
    faces: u32,
    error: f32,
    replaces: Vec<usize>,
}

impl LodFile {
    /// The levels of a document. `None` if it has none, or only levels of another tool.
    pub(super) fn read(document: &gltf::Document, name: &str) -> Option<Self> {
        document.nodes().find_map(|holder| {
            let ids = level_nodes(holder.extension_value("MSFT_lod")?);
            let stamps: Vec<_> = ids.into_iter().filter_map(|id| Some((id, stamp(document, id, name)?))).collect();
            let Some((_, first)) = stamps.first() else {
                debug!("{name}: MSFT_lod of node {} is not by simpliguard and left alone", holder.index());
                return None;
            };
            let replaces = first.replaces.clone();
            let mut levels: Vec<FileLevel> = stamps.into_iter().map(|(node, s)| FileLevel::new(node, &s)).collect();
            levels.sort_by_key(|level| std::cmp::Reverse(level.budget));
            Some(Self { document: document.clone(), holder: holder.index(), replaces, levels })
        })
    }

    pub(super) fn node(&self, index: usize) -> Option<gltf::Node<'_>> {
        self.document.nodes().nth(index)
    }
}

impl FileLevel {
    fn new(node: usize, stamp: &Stamp) -> Self {
        Self { node, level: stamp.level, budget: stamp.budget, faces: stamp.faces, error: stamp.error }
    }
}

fn level_nodes(extension: &Value) -> Vec<usize> {
    let ids = extension.get("ids").and_then(Value::as_array);
    ids.into_iter().flatten().filter_map(|id| usize::try_from(id.as_u64()?).ok()).collect()
}

/// The stamp of a level node. `None` if the node is no level of this program, or cannot be used.
fn stamp(document: &gltf::Document, node: usize, name: &str) -> Option<Stamp> {
    let node = document.nodes().nth(node)?;
    let extras = node.extras().as_ref()?;
    let stamp = deserialize::from_str::<Extras>(extras.get()).ok()?.simpliguard;
    let is_usable = stamp.level > 0 && stamp.error.is_finite() && stamp.error >= 0.0 && node.mesh().is_some();
    if !is_usable {
        warn!("{name}: node {} is a damaged level and is left out; bake the model again", node.index());
    }
    is_usable.then_some(stamp)
}

/// Number of triangles that a primitive draws.
pub(super) fn faces(primitive: &gltf::Primitive<'_>) -> u32 {
    let positions = || primitive.get(&gltf::Semantic::Positions);
    let corners = primitive.indices().or_else(positions).map_or(0, |accessor| accessor.count());
    let faces = match primitive.mode() {
        Mode::Triangles => corners / 3,
        Mode::TriangleStrip | Mode::TriangleFan => corners.saturating_sub(2),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => 0,
    };
    u32::try_from(faces).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn read(nodes: serde_json::Value) -> Option<LodFile> {
        let json = json!({
            "asset": { "version": "2.0" },
            "accessors": [
                { "componentType": 5126, "type": "VEC3", "count": 9, "min": [0, 0, 0], "max": [1, 1, 1] },
                { "componentType": 5123, "type": "SCALAR", "count": 6 },
            ],
            "meshes": [{ "primitives": [
                { "attributes": { "POSITION": 0 } },
                { "attributes": { "POSITION": 0 }, "indices": 1 },
                { "attributes": { "POSITION": 0 }, "indices": 1, "mode": 5 },
                { "attributes": { "POSITION": 0 }, "mode": 1 },
            ] }],
            "nodes": nodes,
        });
        let document = gltf::Gltf::from_slice_without_validation(json.to_string().as_bytes()).expect("glTF").document;
        LodFile::read(&document, "model.glb")
    }

    fn holder(ids: serde_json::Value) -> serde_json::Value {
        json!({ "mesh": 0, "extensions": { "MSFT_lod": { "ids": ids } } })
    }

    fn level(level: u32, budget: u32, error: f32) -> serde_json::Value {
        let stamp = json!({
            "version": "1", "level": level, "budget": budget, "faces": budget - 1, "error": error, "replaces": [0, 3],
        });
        json!({ "mesh": 0, "extras": { "simpliguard": stamp } })
    }

    #[test]
    fn levels_come_in_falling_detail_with_what_they_replace() {
        let file = read(json!([holder(json!([1, 2])), level(1, 10, 0.5), level(2, 20, 0.25)])).expect("levels");
        assert_eq!((file.holder, &file.replaces[..]), (0, &[0, 3][..]));
        let expected = |node, level, budget, error| FileLevel { node, level, budget, faces: budget - 1, error };
        assert_eq!(file.levels, [expected(2, 2, 20, 0.25), expected(1, 1, 10, 0.5)]);
    }

    #[test]
    fn levels_of_another_tool_are_left_alone() {
        assert!(read(json!([holder(json!([1])), { "mesh": 0 }])).is_none());
        assert!(read(json!([holder(json!([1])), { "mesh": 0, "extras": { "simpliguard": 1 } }])).is_none());
        assert!(read(json!([{ "mesh": 0 }])).is_none());
    }

    #[test]
    fn a_level_that_cannot_be_used_is_left_out() {
        let broken = |key: &str, value: serde_json::Value| {
            let mut node = level(1, 10, 0.5);
            node["extras"]["simpliguard"][key] = value;
            node
        };
        let without_mesh = json!({ "extras": level(1, 10, 0.5)["extras"] });
        for node in [broken("error", json!(-0.1)), broken("level", json!(0)), without_mesh] {
            assert!(read(json!([holder(json!([1, 7])), node])).is_none());
        }
    }

    #[test]
    fn faces_are_counted_for_each_mode() {
        let file = read(json!([holder(json!([1])), level(1, 10, 0.5)])).expect("levels");
        let mesh = file.document.meshes().next().expect("a mesh");
        assert_eq!(mesh.primitives().map(|p| faces(&p)).collect::<Vec<_>>(), [3, 2, 4, 0]);
    }
}
