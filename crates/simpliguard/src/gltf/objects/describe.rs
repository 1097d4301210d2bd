//! Tells a scene of many objects from a single model.

use std::collections::BTreeSet;

use glam::{Mat4, Vec3};
use serde_json::Value;

use crate::data::{Document, bounds};

/// Fewest mesh nodes of a scene.
const OBJECTS: usize = 16;
/// Smallest diagonal of a scene, in metres.
const EXTENT: f32 = 15.0;
/// A scene is at least so many times as large as its median object.
const PROPORTION: f32 = 8.0;
/// What a description begins with.
pub(crate) const SCENE_HINT: &str = "it looks like a scene: ";

/// Describes a file that looks like a scene, in words: many separate objects, each small beside the whole. `None` for other
/// files.
pub(crate) fn describe_scene(document: &Document) -> Option<String> {
    let Document { json, mesh_nodes, node_world, .. } = document;
    let nodes = json.get("nodes")?.as_array()?;
    let rigid = mesh_nodes.iter().filter(|&&node| nodes.get(node).is_some_and(|node| node.get("skin").is_none()));
    let rigid: Vec<usize> = rigid.copied().collect();
    if rigid.len() < OBJECTS {
        return None;
    }
    let boxes: Vec<(Vec3, Vec3)> =
        rigid.iter().filter_map(|&node| world_box(json, &nodes[node], *node_world.get(node)?)).collect();
    let ends: Vec<Vec3> = boxes.iter().flat_map(|(low, high)| [*low, *high]).collect();
    let (low, high) = bounds(&ends);
    let mut diagonals: Vec<f32> = boxes.iter().map(|(low, high)| low.distance(*high)).collect();
    diagonals.sort_by(f32::total_cmp);
    let (extent, median) = (low.distance(high), *diagonals.get(diagonals.len() / 2)?);
    if !extent.is_finite() || extent < EXTENT || extent < PROPORTION * median {
        return None;
    }
    let meshes: BTreeSet<u64> = rigid.iter().filter_map(|&node| nodes[node].get("mesh")?.as_u64()).collect();
    let (objects, meshes) = (rigid.len(), meshes.len());
    Some(format!(
        "{SCENE_HINT}{objects} objects of {meshes} meshes, {extent:.0} m across; with `scope: Objects` each gets \
         levels of its own"
    ))
}

/// The box of a node's mesh in the world, by the bounds of its accessors.
fn world_box(json: &Value, node: &Value, world: Mat4) -> Option<(Vec3, Vec3)> {
    let mesh = json.get("meshes")?.get(node.get("mesh")?.as_u64()? as usize)?;
    let mut corners = Vec::new();
    for primitive in mesh.get("primitives")?.as_array()? {
        let accessor = primitive.get("attributes")?.get("POSITION")?.as_u64()?;
        let accessor = json.get("accessors")?.get(accessor as usize)?;
        let end = |key: &str| {
            let at = |axis: usize| accessor.get(key)?.get(axis)?.as_f64().map(|x| x as f32);
            Some(Vec3::new(at(0)?, at(1)?, at(2)?))
        };
        let (low, high) = (end("min")?, end("max")?);
        let corner = |i: u32| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low);
        corners.extend((0..8).map(|i| world.transform_point3(corner(i))));
    }
    (!corners.is_empty()).then(|| bounds(&corners))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn document(objects: usize, spacing: f32, skin: bool) -> Document {
        let node = if skin { json!({ "mesh": 0, "skin": 0 }) } else { json!({ "mesh": 0 }) };
        let json = json!({
            "nodes": vec![node; objects], "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
            "accessors": [{ "min": [-0.5, -0.5, -0.5], "max": [0.5, 0.5, 0.5] }],
        });
        let node_world = (0..objects).map(|i| Mat4::from_translation(Vec3::X * spacing * i as f32)).collect();
        Document { json, mesh_nodes: (0..objects).collect(), node_world, ..Document::default() }
    }

    #[test]
    fn many_small_objects_are_a_scene() {
        let text = describe_scene(&document(20, 2.0, false)).expect("a scene");
        assert!(text.starts_with("it looks like a scene: 20 objects of 1 meshes, 39 m across; with"), "{text}");
    }

    #[test]
    fn a_model_of_parts_is_none() {
        assert_eq!(describe_scene(&document(15, 2.0, false)), None, "few parts");
        assert_eq!(describe_scene(&document(20, 0.5, false)), None, "a small thing");
        assert_eq!(describe_scene(&document(20, 2.0, true)), None, "a character");
        assert_eq!(describe_scene(&Document::default()), None);
        let mut large = document(20, 2.0, false);
        large.json["accessors"][0]["max"] = json!([20.0, 20.0, 20.0]);
        assert_eq!(describe_scene(&large), None, "large parts, as those of a ship");
    }
}
