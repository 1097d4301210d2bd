//! What every candidate reads.

use super::{DeviationMetric, Importance, OpaqueSurface};
use crate::Cancellation;
use crate::animation::{Motions, Poses};
use crate::data::{Influences, Model, TriMesh};
use crate::geometry::{BoundingSphere, Bvh};
use crate::render::View;
use crate::skinning::{self, SkinSource, Transfer};

/// What shapes are made from and judged by.
pub struct Inputs<'a> {
    /// The source.
    pub model: &'a Model,
    /// Over its triangles.
    pub bvh: &'a Bvh,
    /// Where influences come from.
    pub skin_source: &'a SkinSource<'a>,
    /// Its triangles that can be seen at all.
    pub opaque: &'a OpaqueSurface,
    /// Measures distances to them.
    pub deviation_metric: &'a DeviationMetric<'a>,
    /// Around the source.
    pub frame: BoundingSphere,
    /// The source's pictures, in the rest pose and in `poses`.
    pub views: &'a [View],
    /// Poses that its clips put it in.
    pub poses: Option<&'a Poses<'a>>,
    /// How much its triangles count, unless they all count alike.
    pub importance: Option<&'a Importance>,
    /// Looked at within the steps.
    pub cancellation: &'a Cancellation,
}

impl Inputs<'_> {
    /// How a mesh in the rest pose hangs on the source's bones.
    pub(super) fn influences(&self, mesh: &TriMesh) -> Vec<Influences> {
        skinning::transfer(self.skin_source, mesh, &mesh.vertex_normals(), Transfer::default()).0
    }

    /// How a mesh in the rest pose moves with them.
    pub(super) fn motions(&self, mesh: &TriMesh) -> Motions {
        self.poses.map_or_else(Motions::default, |poses| poses.all_motions(&self.influences(mesh)))
    }
}
