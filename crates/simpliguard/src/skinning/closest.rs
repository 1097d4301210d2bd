//! Influences at the closest point of the source's surface.

use glam::Vec3;
use rayon::prelude::*;

use super::SkinSource;
use crate::animation::{Weights, corner_weights, weights_at};
use crate::data::{Surface, TriMesh};
use crate::geometry::Hit;

/// What a point must keep to count as a match.
#[derive(Clone, Copy)]
pub(super) struct MatchLimits {
    /// Farthest, in metres.
    pub(super) distance: f32,
    /// Smallest cosine between the normals.
    pub(super) cosine: f32,
}

/// What the source says about one vertex of the level.
pub(super) struct Sample {
    /// Influences at the closest point.
    pub(super) weights: Weights,
    /// Whether the point is within the limits.
    pub(super) is_match: bool,
}

/// The closest point's influences for each vertex of `mesh`.
pub(super) fn sample(
    skin_source: &SkinSource<'_>,
    mesh: &TriMesh,
    normals: &[Vec3],
    limits: MatchLimits,
) -> Vec<Sample> {
    let (model, surface) = (skin_source.model, &skin_source.model.surface);
    let sample = |(hit, normal): (Option<Hit>, &Vec3)| {
        let Some(hit) = hit else {
            return Sample { weights: Weights::default(), is_match: false };
        };
        let triangle = hit.triangle as usize;
        let parts = corner_weights(surface, triangle, hit.point);
        let weights = weights_at(surface, triangle, parts);
        let mut cosine = normal.dot(normal_at(surface, triangle, parts));
        if model.materials.get(surface.material[triangle] as usize).is_some_and(|m| m.double_sided) {
            cosine = cosine.abs();
        }
        Sample { weights, is_match: hit.distance <= limits.distance && cosine >= limits.cosine }
    };
    skin_source.closest(mesh).into_par_iter().zip(normals).map(sample).collect()
}

/// The interpolated vertex normal.
fn normal_at(surface: &Surface, triangle: usize, parts: [f32; 3]) -> Vec3 {
    let corners = surface.triangles[triangle];
    let sum: Vec3 = corners.iter().zip(parts).map(|(&v, part)| surface.normals[v as usize] * part).sum();
    sum.normalize_or_zero()
}
