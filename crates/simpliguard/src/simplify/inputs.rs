//! Everything that candidates are made from and scored by.

use super::deviation::DeviationMetric;
use super::importance::Importance;
use super::opaque::OpaqueSurface;
use crate::Cancellation;
use crate::animation::{Motions, Poses};
use crate::data::{Influences, Model, Reconstruction, TriMesh};
use crate::geometry::{BoundingSphere, Bvh};
use crate::render::View;

/// The source, prepared for the stage.
pub struct Inputs<'a> {
    /// The source.
    pub model: &'a Model,
    /// Over its triangles.
    pub bvh: &'a Bvh,
    /// Connected part of each triangle. Empty for a source that keeps still.
    pub parts: &'a [u32],
    /// Its triangles that are not all but clear.
    pub opaque: &'a OpaqueSurface,
    /// Measures distances to them.
    pub deviation_metric: &'a DeviationMetric<'a>,
    /// Around the source.
    pub sphere: BoundingSphere,
    /// Views of the source, in the rest pose and in `poses`.
    pub views: &'a [View],
    /// Poses that the clips of the source put it in.
    pub poses: Option<&'a Poses<'a>>,
    /// Weights of the triangles; `None` if all count alike.
    pub importance: Option<&'a Importance>,
    /// The other stages.
    pub tools: &'a dyn Tools,
    /// Looked at within the steps.
    pub cancellation: &'a Cancellation,
}

/// Work of other stages that candidates need. Stages do not import each other: the pipeline hands this in.
pub trait Tools: Sync {
    /// A watertight surface around `mesh`, whose triangles `bvh` holds.
    fn reconstruct(&self, mesh: &TriMesh, bvh: &Bvh, params: &Reconstruction) -> TriMesh;

    /// Influences of each vertex of a mesh in the rest pose, taken over from the source.
    fn influences(&self, mesh: &TriMesh) -> Vec<Influences>;

    /// There are planes to split faces along.
    fn has_joint_planes(&self) -> bool;

    /// `mesh` with its faces split along the joint planes, within `most` faces.
    fn split_at_joints(&self, mesh: &TriMesh, most: usize) -> TriMesh;
}

impl Inputs<'_> {
    /// The connected part of the source that a triangle belongs to.
    pub(super) fn part(&self, triangle: u32) -> u32 {
        self.parts[triangle as usize]
    }

    /// Motions of a mesh in the rest pose into all poses.
    pub(super) fn motions(&self, mesh: &TriMesh) -> Motions {
        self.poses.map_or_else(Motions::default, |poses| poses.all_motions(&self.tools.influences(mesh)))
    }
}
