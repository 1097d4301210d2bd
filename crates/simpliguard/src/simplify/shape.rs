//! What a candidate leads to.

use crate::data::{Candidate, Cards, Deviation, TriMesh};

/// A mesh within a budget.
#[derive(Clone, Debug)]
pub struct Shape {
    /// World space.
    pub mesh: TriMesh,
    /// Back faces are seen too.
    pub double_sided: bool,
    /// Where it came from.
    pub candidate: Candidate,
    /// Error against the source's pictures that no texture removes, mean square per pixel.
    pub render_error: f64,
    /// Distances to the source, in the rest pose.
    pub deviation: Deviation,
    /// Faces that pass through others.
    pub self_intersecting: usize,
    /// Which faces are cut-out cards, if the source is foliage.
    pub cards: Option<Cards>,
}

impl Shape {
    pub(super) fn unjudged(mesh: TriMesh, double_sided: bool, candidate: Candidate, cards: Option<Cards>) -> Self {
        let (render_error, deviation) = (f64::INFINITY, Deviation::default());
        Self { mesh, double_sided, candidate, render_error, deviation, self_intersecting: 0, cards }
    }
}
