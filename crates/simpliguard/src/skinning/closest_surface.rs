//! Influences at the closest points of the source's surface.

use glam::Vec3;
use rayon::prelude::*;

use super::skin_source::SkinSource;
use crate::animation::{Weights, corner_weights, weights_at};
use crate::data::{Model, Surface, TriMesh, bounds};
use crate::geometry::Hit;

/// Largest distance of a match, as a fraction of the diagonal of the source's bounding box.
pub(super) const MAX_DISTANCE: f32 = 0.05;
/// Largest angle between the normals of a match, in degrees.
pub(super) const MAX_ANGLE: f32 = 90.0;

/// Limits within which the closest point of the source matches a vertex.
#[derive(Clone, Copy)]
pub(super) struct MatchLimits {
    /// Largest distance, in metres.
    pub(super) distance: f32,
    /// Smallest cosine between the normals.
    pub(super) cosine: f32,
}

impl MatchLimits {
    /// Limits for a source: `max_distance` is a fraction of the diagonal of its bounding box, `max_angle` is in
    /// degrees.
    pub(super) fn new(source: &Model, max_distance: f32, max_angle: f32) -> Self {
        let (low, high) = bounds(&source.surface.positions);
        Self {
            distance: max_distance * low.distance(high),
            cosine: libm::cosf(max_angle.clamp(0.0, 180.0).to_radians()),
        }
    }
}

/// The closest point of the source to a vertex of the level.
pub(super) struct SurfaceMatch {
    /// Influences at the point.
    pub(super) weights: Weights,
    /// True if the point is within the limits.
    pub(super) is_match: bool,
}

/// The closest point of the source for each vertex of `mesh`, which has the unit vertex `normals`.
pub(super) fn closest_matches(
    source: &SkinSource<'_>,
    mesh: &TriMesh,
    normals: &[Vec3],
    limits: MatchLimits,
) -> Vec<SurfaceMatch> {
    let (model, surface) = (source.model, &source.model.surface);
    let closest = |(hit, normal): (Option<Hit>, &Vec3)| {
        let Some(hit) = hit else {
            return SurfaceMatch { weights: Weights::default(), is_match: false };
        };
        let triangle = hit.triangle as usize;
        let barycentric = corner_weights(surface, triangle, hit.point);
        let weights = weights_at(surface, triangle, barycentric);
        let mut cosine = normal.dot(normal_at(surface, triangle, barycentric));
        if model.materials.get(surface.material[triangle] as usize).is_some_and(|m| m.double_sided) {
            cosine = cosine.abs();
        }
        SurfaceMatch { weights, is_match: hit.distance <= limits.distance && cosine >= limits.cosine }
    };
    source.closest(mesh).into_par_iter().zip(normals).map(closest).collect()
}

/// The interpolated vertex normal at a point of a triangle.
fn normal_at(surface: &Surface, triangle: usize, barycentric: [f32; 3]) -> Vec3 {
    let corners = surface.triangles[triangle];
    let sum: Vec3 = corners.iter().zip(barycentric).map(|(&v, weight)| surface.normals[v as usize] * weight).sum();
    sum.normalize_or_zero()
}
