//! The choice of the morph targets that the levels take over.
//!
//! A level is one mesh with one list of weights. Its targets are those of the first node that has any. Other nodes may
//! have targets with the same names and default weights, like the head, teeth and lashes of one face: they are assumed
//! to be driven in the same way. The targets of all other nodes stay at their default weights.

use serde_json::Value;

use super::accessor::Reader;
use super::schema::Node;
use crate::data::{MorphTarget, Morphs};

/// The node that drives the targets, and the nodes that follow it.
#[derive(Debug, Default)]
pub(super) struct Driver {
    /// The targets, without displacements.
    pub(super) morphs: Option<Morphs>,
    /// Nodes whose meshes have these targets, ascending.
    nodes: Vec<usize>,
    /// Notes for the report: targets that stay at their default weights.
    pub(super) notes: Vec<String>,
}

impl Driver {
    /// The driver of a file whose triangles are at `mesh_nodes`.
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

    /// True if the mesh of a node has these targets.
    pub(super) fn drives(&self, node: usize) -> bool {
        self.nodes.binary_search(&node).is_ok()
    }
}

/// The targets of a node's mesh, with names and weights: as many as its primitive with the most targets has.
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
        displacements: Vec::new(),
    };
    (0..count).map(target).collect()
}
