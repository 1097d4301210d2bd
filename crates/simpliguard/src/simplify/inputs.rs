//! The inputs of the stage: the source, its views, and the work of other stages.

use glam::Vec3;

use super::deviation::DeviationMetric;
use super::importance::Importance;
use super::opaque::OpaqueSurface;
use crate::Cancellation;
use crate::animation::{Motions, Poses};
use crate::data::{Cards, Influences, Model, Reconstruction, TriMesh};
use crate::geometry::{BoundingSphere, Bvh};
use crate::render::View;

/// Everything that candidates are generated from and scored by.
pub struct Inputs<'a> {
    /// The source.
    pub model: &'a Model,
    /// Over the triangles of the source.
    pub bvh: &'a Bvh,
    /// Connected component of each triangle of the source. Empty for a source that does not move.
    pub components: &'a [u32],
    /// The triangles of the source that are not nearly transparent.
    pub opaque: &'a OpaqueSurface,
    /// Measures distances to the opaque triangles.
    pub deviation_metric: &'a DeviationMetric<'a>,
    /// Bounding sphere of the source.
    pub sphere: BoundingSphere,
    /// Views of the source, in the rest pose and in `poses`.
    pub views: &'a [View],
    /// Poses from the clips of the source; `None` if it does not move.
    pub poses: Option<&'a Poses<'a>>,
    /// Weights of the source's triangles; `None` if all count alike.
    pub importance: Option<&'a Importance>,
    /// The work of other stages.
    pub tools: &'a dyn Tools,
    /// Ends the stage early.
    pub cancellation: &'a Cancellation,
}

/// Work of other stages that candidates need. Stages do not import each other: the pipeline hands this in.
pub trait Tools: Sync {
    /// A watertight surface around `mesh`, which leaves the space around `free` points open. `bvh` holds the triangles of
    /// `mesh`.
    fn reconstruct(&self, mesh: &TriMesh, bvh: &Bvh, free: &[Vec3], params: &Reconstruction) -> TriMesh;

    /// Influences of each vertex of a mesh in the rest pose, transferred from the source.
    fn influences(&self, mesh: &TriMesh) -> Vec<Influences>;

    /// True if there are planes along which faces are split.
    fn has_joint_planes(&self) -> bool;

    /// `mesh` with its faces split along the joint planes, within `most` faces.
    fn split_at_joints(&self, mesh: &TriMesh, most: usize) -> TriMesh;

    /// For each point of a mesh, true if the source is not cut out there. A point is a face and barycentric coordinates;
    /// `areas` has the area that a point of each face stands for.
    fn shown(&self, mesh: &TriMesh, cards: Option<&Cards>, points: &[(u32, Vec3)], areas: &[f32]) -> Vec<bool>;
}

impl Inputs<'_> {
    /// The connected component of a triangle of the source.
    pub(super) fn component(&self, triangle: u32) -> u32 {
        self.components[triangle as usize]
    }

    /// Motions of a mesh from the rest pose into all poses.
    pub(super) fn motions(&self, mesh: &TriMesh) -> Motions {
        self.poses.map_or_else(Motions::default, |poses| poses.all_motions(&self.tools.influences(mesh)))
    }
}
