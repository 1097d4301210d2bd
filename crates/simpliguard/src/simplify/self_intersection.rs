//! How much self-intersection is tolerated: all thresholds in one place. Each is a fraction of the faces of a mesh.
//!
//! The values were found by baking the models of the benchmark and comparing rendered error, validity and distance to the
//! source; `docs/results.md` has the figures.

use crate::data::TriMesh;
use crate::geometry::self_intersecting;

/// Up to this fraction a mesh counts as clean: the bar that levels are measured by.
pub(super) const TOLERATED: f64 = 0.01;
/// From this fraction on a mesh counts as badly self-intersecting: the handicap in the selection is full.
pub(super) const SEVERE: f64 = 0.05;
/// Up to this fraction it is worth resolving deep contacts, too. Above it too many stay for the mesh to become clean.
pub(super) const WORTH_DEEP_RESOLUTION: f64 = 0.06;

/// Number of self-intersecting faces.
pub(super) fn count(mesh: &TriMesh) -> usize {
    self_intersecting(mesh).into_iter().filter(|face| *face).count()
}

/// Fraction of the faces that intersect others.
pub(super) fn fraction(mesh: &TriMesh) -> f64 {
    count(mesh) as f64 / mesh.triangles.len().max(1) as f64
}
