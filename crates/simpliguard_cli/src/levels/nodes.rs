//! The nodes of a document: those of its scene, those of levels, and the objects whose levels they are.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::inspect::document::{INSTANCING, index};

/// A node that is a level, and what it says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LevelNode {
    pub(super) node: usize,
    pub(super) mesh: Option<usize>,
    pub(super) level: u64,
    pub(super) budget: Option<u64>,
    pub(super) faces: Option<u64>,
    pub(super) error: Option<f64>,
    /// The node whose level it is, in a scene of objects.
    pub(super) object: Option<usize>,
    /// The mesh nodes that it stands for.
    replaces: Vec<usize>,
    /// True if it stands for all objects of a scene.
    pub(super) whole: bool,
}

/// An object of a scene.
pub(super) struct Object<'a> {
    pub(super) holder: usize,
    /// The mesh nodes that its levels stand for, ascending.
    pub(super) replaces: Vec<usize>,
    /// The smallest first; not empty.
    pub(super) levels: Vec<&'a LevelNode>,
}

/// All levels of a document, by their numbers.
pub(super) fn level_nodes(json: &Value) -> Vec<LevelNode> {
    let mut levels: Vec<LevelNode> =
        nodes(json).iter().enumerate().filter_map(|(i, node)| LevelNode::read(i, node)).collect();
    levels.sort_by_key(|level| level.level);
    levels
}

impl LevelNode {
    fn read(node: usize, value: &Value) -> Option<Self> {
        let stamp = stamp(value)?;
        Some(Self {
            node,
            mesh: index(value, "mesh"),
            level: stamp.get("level")?.as_u64()?,
            budget: stamp.get("budget").and_then(Value::as_u64),
            faces: stamp.get("faces").and_then(Value::as_u64),
            error: stamp.get("error").and_then(Value::as_f64),
            object: index(stamp, "object"),
            replaces: indices(stamp, "replaces"),
            whole: stamp.get("whole").and_then(Value::as_bool).unwrap_or_default(),
        })
    }
}

/// The objects whose levels these are, in the order of their first mesh nodes.
pub(super) fn objects_of<'a>(json: &Value, levels: &'a [LevelNode]) -> Vec<Object<'a>> {
    let mut objects: BTreeMap<usize, Object<'a>> = BTreeMap::new();
    let exists = |holder: &usize| *holder < nodes(json).len();
    for level in levels {
        let Some(holder) = level.object.filter(exists) else { continue };
        let new = || Object { holder, replaces: Vec::new(), levels: Vec::new() };
        let object = objects.entry(holder).or_insert_with(new);
        object.levels.push(level);
        object.replaces.extend(&level.replaces);
    }
    let mut objects: Vec<Object<'a>> = objects.into_values().collect();
    for object in &mut objects {
        object.replaces.sort_unstable();
        object.replaces.dedup();
    }
    objects.sort_by_key(|object| object.replaces.first().copied());
    objects
}

/// The nodes of the default scene that have meshes.
pub(super) fn mesh_nodes(json: &Value) -> BTreeSet<usize> {
    let has_mesh = |node: &usize| nodes(json).get(*node).is_some_and(|node| node.get("mesh").is_some());
    below(json, &scene_roots(json)).into_iter().filter(has_mesh).collect()
}

/// The root nodes of the default scene; of a document without scenes, the nodes without a parent.
pub(super) fn scene_roots(json: &Value) -> Vec<usize> {
    let scene = index(json, "scene").unwrap_or(0);
    match json.get("scenes").and_then(Value::as_array).filter(|scenes| !scenes.is_empty()) {
        Some(scenes) => scenes.get(scene).map(|scene| indices(scene, "nodes")).unwrap_or_default(),
        None => {
            let children: BTreeSet<usize> = nodes(json).iter().flat_map(|node| indices(node, "children")).collect();
            (0..nodes(json).len()).filter(|node| !children.contains(node)).collect()
        }
    }
}

/// `roots` and all nodes below them.
pub(crate) fn below(json: &Value, roots: &[usize]) -> BTreeSet<usize> {
    let (mut seen, mut left) = (BTreeSet::new(), roots.to_vec());
    while let Some(next) = left.pop() {
        if let (true, Some(node)) = (seen.insert(next), nodes(json).get(next)) {
            left.extend(indices(node, "children"));
        }
    }
    seen
}

/// Tells whether a node is drawn many times by `EXT_mesh_gpu_instancing`.
pub(super) fn has_instances(json: &Value, node: usize) -> bool {
    nodes(json).get(node).and_then(|node| node.get("extensions")?.get(INSTANCING)).is_some()
}

/// What a node says of itself.
pub(super) fn stamp(node: &Value) -> Option<&Value> {
    node.get("extras")?.get("simpliguard")
}

fn nodes(json: &Value) -> &[Value] {
    json.get("nodes").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
}

/// A list of indices; empty if there is none.
pub(crate) fn indices(object: &Value, name: &str) -> Vec<usize> {
    let list = object.get(name).and_then(Value::as_array).into_iter().flatten();
    list.filter_map(|index| usize::try_from(index.as_u64()?).ok()).collect()
}
