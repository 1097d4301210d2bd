//! The mesh that is reduced, with its errors.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::quadric::AttributeQuadric;
use super::wedges::WedgeMesh;
use crate::Cancellation;
use crate::simplify::qem::Quadric;

/// Weights of each face: of its shape and of what it carries.
pub(super) struct FaceWeights {
    pub(super) shape: Vec<f64>,
    pub(super) attributes: Vec<f64>,
}

/// A mesh of wedges on its way down to a budget.
pub(super) struct Reducer<'a> {
    pub(super) mesh: WedgeMesh,
    /// Positions of the points in the rest pose and in all others.
    pub(super) poses: Vec<Vec<DVec3>>,
    /// For each point its quadric in each pose.
    pub(super) shape: Vec<Quadric>,
    /// For each wedge.
    pub(super) attributes: Vec<AttributeQuadric>,
    /// Weight of the shape of each face.
    pub(super) weights: Vec<f64>,
    /// Points may move to places without a vertex of the source: nothing moves the model.
    pub(super) may_place: bool,
    /// Raised whenever a point changes.
    pub(super) stamps: Vec<u32>,
    pub(super) queue: BinaryHeap<Reverse<Queued>>,
    pub(super) cancellation: &'a Cancellation,
}

/// An edge, ordered by the cost of its cheapest collapse that was not refused.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Queued {
    /// Bits of the cost, which is not negative.
    pub(super) cost: u64,
    pub(super) u: u32,
    pub(super) v: u32,
    /// Number of collapses that were refused.
    pub(super) refused: usize,
    /// Stamps of both points when the entry was made.
    pub(super) stamps: [u32; 2],
}

impl<'a> Reducer<'a> {
    /// `poses` are the positions of the points in further poses, in the unit sphere.
    pub(super) fn new(
        mesh: WedgeMesh,
        poses: Vec<Vec<DVec3>>,
        weights: FaceWeights,
        cancellation: &'a Cancellation,
    ) -> Self {
        let may_place = poses.is_empty();
        let poses: Vec<Vec<DVec3>> = std::iter::once(mesh.positions.clone()).chain(poses).collect();
        let points = mesh.positions.len();
        let mut out = Self {
            shape: vec![Quadric::default(); points * poses.len()],
            attributes: vec![AttributeQuadric::default(); mesh.wedges.len()],
            weights: weights.shape,
            may_place,
            stamps: vec![0; points],
            queue: BinaryHeap::new(),
            mesh,
            poses,
            cancellation,
        };
        out.add_faces(&weights.attributes);
        out.add_creases();
        for u in 0..points as u32 {
            out.mesh.neighbours(u).into_iter().filter(|v| u < *v).for_each(|v| out.push(u, v, 0));
        }
        out
    }

    pub(super) fn shape_mut(&mut self, point: u32, pose: usize) -> &mut Quadric {
        let poses = self.poses.len();
        &mut self.shape[point as usize * poses + pose]
    }

    pub(super) fn stamps_of(&self, u: u32, v: u32) -> [u32; 2] {
        [u, v].map(|p| self.stamps[p as usize])
    }
}
