//! Self-intersections of a mesh, and all thresholds that say how many are tolerated and which are resolved.
//!
//! The thresholds on faces and pairs are fractions of all faces of a mesh. The depths are fractions of its mean edge length. The
//! values were found by baking the models of the benchmark and comparing rendered error, validity and distance to the
//! source; `docs/results.md` has the figures.

use super::self_intersecting;
use crate::data::TriMesh;

/// Up to this fraction of self-intersecting faces a mesh counts as clean. Levels are measured by the same limit.
pub(crate) const TOLERATED: f64 = 0.01;
/// From this fraction on a mesh counts as severely self-intersecting. Its handicap in the selection is full.
pub(crate) const SEVERE: f64 = 0.05;
/// Below this fraction deep contacts are resolved, too. Above it too many remain for the mesh to become clean.
pub(crate) const WORTH_DEEP_RESOLUTION: f64 = 0.06;
/// Above this fraction no contact is resolved: so many contacts pull at each other that the mesh stays
/// self-intersecting.
pub(crate) const WORTH_RESOLUTION: f64 = 0.2;

/// Above this many intersecting pairs, as a fraction of the number of faces, refinement lets faces slide: new pairs may form
/// next to the old ones. Otherwise such meshes would hardly move.
pub(crate) const SLIDING_PAIRS: f64 = 0.015;

/// Contacts up to this depth are resolved first: the vertices move little.
pub(crate) const SHALLOW_CONTACT: f64 = 0.1;
/// Contacts up to this depth are resolved if the shallow ones are not enough. Deeper ones, such as an arm in a body,
/// belong to the model.
pub(crate) const DEEP_CONTACT: f64 = 0.5;

/// Number of self-intersecting faces.
pub(crate) fn count(mesh: &TriMesh) -> usize {
    self_intersecting(mesh).into_iter().filter(|face| *face).count()
}

/// Fraction of the faces that are self-intersecting.
pub(crate) fn fraction(mesh: &TriMesh) -> f64 {
    count(mesh) as f64 / mesh.triangles.len().max(1) as f64
}
