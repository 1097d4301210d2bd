//! Error in motion: the planes of the faces in other poses of the source.
//!
//! After "Deformation Sensitive Decimation" (Mohr and Gleicher 2003): a vertex has a quadric for each pose besides that
//! of the rest pose, and the cost of a collapse is the sum of the errors. They optimise one position per pose. Here
//! only the position in the rest pose is optimised; it is moved into a pose by the blend of the motions of the edge's
//! ends, as skinning will move it. So an edge along which the weights are linear costs nothing, and a bend of the
//! weights is kept.

use glam::{DAffine3, DMat3, DVec3};

use super::quadric::Quadric;

/// The slot of a vertex that had no faces when the poses were added.
const NO_SLOT: u32 = u32::MAX;

/// Quadrics and motions in each pose, for the vertices that had faces when the poses were added.
#[derive(Clone)]
pub(super) struct PosedQuadrics {
    poses: usize,
    /// Slot of each vertex in the lists below, or [`NO_SLOT`]. A slot has one entry for each pose.
    slots: Vec<u32>,
    quadrics: Vec<Quadric>,
    motions: Vec<DAffine3>,
}

impl PosedQuadrics {
    /// Quadrics of zero for `live`, some of all `vertices`, which `motions` moves: for each of `live`, one motion for
    /// each of the poses.
    pub(super) fn new(vertices: usize, live: &[u32], motions: Vec<DAffine3>) -> Self {
        let mut slots = vec![NO_SLOT; vertices];
        for (slot, &v) in (0u32..).zip(live) {
            slots[v as usize] = slot;
        }
        let poses = motions.len() / live.len().max(1);
        Self { poses, slots, quadrics: vec![Quadric::default(); motions.len()], motions }
    }

    /// Number of poses.
    pub(super) fn poses(&self) -> usize {
        self.poses
    }

    fn start(&self, vertex: u32) -> usize {
        self.slots[vertex as usize] as usize * self.poses
    }

    fn of(&self, vertex: u32) -> impl Iterator<Item = (&Quadric, &DAffine3)> {
        let own = self.start(vertex)..self.start(vertex) + self.poses;
        self.quadrics[own.clone()].iter().zip(&self.motions[own])
    }

    /// The position of a vertex in a pose, given its position in the rest pose.
    pub(super) fn posed(&self, vertex: u32, pose: usize, position: DVec3) -> DVec3 {
        self.motions[self.start(vertex) + pose].transform_point3(position)
    }

    /// Adds a quadric to a vertex in a pose.
    pub(super) fn add(&mut self, vertex: u32, pose: usize, quadric: &Quadric) {
        let start = self.start(vertex);
        self.quadrics[start + pose].add(quadric);
    }

    /// Sum over the poses of the error of the edge `u v`, collapsed to `position` in the rest pose. `t` is the
    /// parameter of `position` along the edge, 0 at `u` and 1 at `v`.
    pub(super) fn error(&self, u: u32, v: u32, t: f64, position: DVec3) -> f64 {
        let both = self.of(u).zip(self.of(v));
        both.map(|((qu, mu), (qv, mv))| {
            let moved = mu.transform_point3(position).lerp(mv.transform_point3(position), t);
            qu.error(moved) + qv.error(moved)
        })
        .sum()
    }

    /// Merges `v` into `u`, at the parameter `t` along the edge from `u` to `v`.
    pub(super) fn merge(&mut self, u: u32, v: u32, t: f64) {
        let [u, v] = [u, v].map(|vertex| self.start(vertex));
        for pose in 0..self.poses {
            let other = self.quadrics[v + pose];
            self.quadrics[u + pose].add(&other);
            self.motions[u + pose] = blend(&self.motions[u + pose], &self.motions[v + pose], t);
        }
    }
}

fn blend(a: &DAffine3, b: &DAffine3, t: f64) -> DAffine3 {
    let columns = |m: &DAffine3| [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis, m.translation];
    let [x, y, z, w] = std::array::from_fn(|k| columns(a)[k].lerp(columns(b)[k], t));
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: w }
}
