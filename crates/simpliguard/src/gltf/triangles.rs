//! Triangles of meshes and nodes, counted without their data.

use serde_json::Value;

use super::export::builder::{Builder, Kind, index};

/// Number of triangles of a mesh.
pub(super) fn of_mesh(out: &Builder, mesh: usize) -> u64 {
    of_primitives(out, mesh).sum()
}

/// Number of triangles of each primitive of a mesh.
pub(super) fn of_primitives(out: &Builder, mesh: usize) -> impl Iterator<Item = u64> {
    let primitives = out.all(Kind::Mesh).get(mesh).and_then(|mesh| mesh.get("primitives")?.as_array());
    primitives.into_iter().flatten().map(|primitive| of_primitive(out, primitive))
}

/// Number of triangles that a node shows, over all instances.
pub(super) fn of_node(out: &Builder, node: usize) -> u64 {
    let Some(node) = out.all(Kind::Node).get(node) else { return 0 };
    let attributes = node.pointer("/extensions/EXT_mesh_gpu_instancing/attributes").and_then(Value::as_object);
    let first = attributes.and_then(|attributes| attributes.values().next()?.as_u64());
    let instances = first.map_or(1, |accessor| count(out, accessor as usize));
    instances * index(node, "mesh").map_or(0, |mesh| of_mesh(out, mesh))
}

fn of_primitive(out: &Builder, primitive: &Value) -> u64 {
    let corners = index(primitive, "indices").or_else(|| index(primitive.get("attributes")?, "POSITION"));
    let corners = corners.map_or(0, |accessor| count(out, accessor));
    match primitive.get("mode").and_then(Value::as_u64).unwrap_or(4) {
        4 => corners / 3,
        5 | 6 => corners.saturating_sub(2),
        _ => 0,
    }
}

fn count(out: &Builder, accessor: usize) -> u64 {
    out.all(Kind::Accessor).get(accessor).and_then(|accessor| accessor.get("count")?.as_u64()).unwrap_or(0)
}
