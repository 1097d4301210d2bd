//! Which of a file's morph targets its levels take over.
//!
//! A level is one mesh with one list of weights. Its targets are those of the first node that has any; other nodes with
//! targets of the same names and default weights, as the head, teeth and lashes of one face, are taken to be driven
//! alike. The targets of all others stay at their default weights.

use serde_json::Value;

use super::accessor::Reader;
use super::schema::Node;
use crate::data::{MorphTarget, Morphs};

/// The node that drives the targets, and those that go with it.
#[derive(Debug, Default)]
pub(super) struct Driver {
    /// The targets, without what they move.
    pub(super) morphs: Option<Morphs>,
    /// Nodes whose meshes have these targets, ascending.
    nodes: Vec<usize>,
    /// What stays still, in words.
    pub(super) notes: Vec<String>,
}

impl Driver {
    /// The driver of a file with these nodes with triangles.
    pub(super) fn of(reader: Reader<'_>, json: &Value, mesh_nodes: &[usize]) -> Self {
        let mut out = Self::default();
        for &index in mesh_nodes {
            let targets = targets(reader, json, &reader.root.nodes[index]);
            if targets.is_empty() {
                continue;
            }
            let count = targets.len();
            let first = out.morphs.get_or_insert_with(|| Morphs { node: index, targets: targets.clone() });
            let is_named = targets.iter().all(|target| !target.name.is_empty());
            if index == first.node || (is_named && targets == first.targets) {
                out.nodes.push(index);
            } else {
                let driver = first.node;
                out.notes.push(format!(
                    "{count} morph targets of node {index} stay at their default weights in the levels: they are not those of node {driver}"
                ));
            }
        }
        out
    }

    /// Whether the mesh of a node goes with the targets.
    pub(super) fn drives(&self, node: usize) -> bool {
        self.nodes.binary_search(&node).is_ok()
    }
}

/// The targets of a node's mesh, with names and weights: as many as the primitive with the most has.
fn targets(reader: Reader<'_>, json: &Value, node: &Node<'_>) -> Vec<MorphTarget> {
    let Some((index, mesh)) = node.mesh.and_then(|index| Some((index, reader.root.meshes.get(index)?))) else {
        return Vec::new();
    };
    let count = mesh.primitives.iter().map(|primitive| primitive.targets.len()).max().unwrap_or(0);
    let names = json.get("meshes").and_then(|meshes| meshes.get(index)?.get("extras")?.get("targetNames"));
    let weights = node.weights.as_ref().unwrap_or(&mesh.weights);
    let target = |k: usize| MorphTarget {
        name: names.and_then(|names| names.get(k)?.as_str()).unwrap_or_default().to_owned(),
        weight: weights.get(k).copied().unwrap_or(0.0),
        moves: Vec::new(),
    };
    (0..count).map(target).collect()
}
