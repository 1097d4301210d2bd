//! Morph targets of a source model.

use glam::Vec3;

/// Morph targets whose weights one node drives.
#[derive(Clone, Debug, PartialEq)]
pub struct Morphs {
    /// Index of the node in the glTF's `nodes`.
    pub node: usize,
    /// In the node's order.
    pub targets: Vec<MorphTarget>,
}

/// One morph target.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MorphTarget {
    /// From the mesh's `extras.targetNames`; empty if unnamed.
    pub name: String,
    /// Its weight in the rest pose.
    pub weight: f32,
    /// Vertices and their displacements at a weight of one, in world space at rest, in metres. Ascending by vertex,
    /// without the vertices that stay.
    pub displacements: Vec<(u32, Vec3)>,
}

impl MorphTarget {
    /// The displacement of a vertex; zero if it stays.
    pub fn displacement(&self, vertex: u32) -> Vec3 {
        let found = self.displacements.binary_search_by_key(&vertex, |(v, _)| *v);
        found.map_or(Vec3::ZERO, |at| self.displacements[at].1)
    }
}
