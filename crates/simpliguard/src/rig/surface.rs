//! Influences at the closest point of the source's surface.

use glam::Vec3;
use rayon::prelude::*;

use super::parts::Donor;
use super::weights::Weights;
use crate::mesh::TriMesh;
use crate::model::{Influences, Surface};
use crate::{Bvh, Hit};

/// What a point must keep to count as a match.
#[derive(Clone, Copy)]
pub(super) struct Limits {
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
pub(super) fn sample(donor: &Donor<'_>, mesh: &TriMesh, normals: &[Vec3], limits: Limits) -> Vec<Sample> {
    let (model, surface) = (donor.model, &donor.model.surface);
    let sample = |(hit, normal): (Option<Hit>, &Vec3)| {
        let Some(hit) = hit else {
            return Sample { weights: Weights::default(), is_match: false };
        };
        let triangle = hit.triangle as usize;
        let parts = parts_at(surface, triangle, hit.point);
        let weights = weights_at(surface, triangle, parts);
        let mut cosine = normal.dot(normal_at(surface, triangle, parts));
        if model.materials.get(surface.material[triangle] as usize).is_some_and(|m| m.double_sided) {
            cosine = cosine.abs();
        }
        Sample { weights, is_match: hit.distance <= limits.distance && cosine >= limits.cosine }
    };
    donor.closest(mesh).into_par_iter().zip(normals).map(sample).collect()
}

/// The closest point's influences for each position, whatever its distance.
pub(super) fn closest_influences(surface: &Surface, bvh: &Bvh, positions: &[Vec3]) -> Vec<Influences> {
    let closest = |&position: &Vec3| {
        let hit = bvh.closest(position, f32::INFINITY);
        hit.map_or(Influences::rigid(0), |hit| influences_at(surface, hit.triangle as usize, hit.point))
    };
    positions.par_iter().with_min_len(1024).map(closest).collect()
}

/// Influences at a point of a triangle.
pub(super) fn influences_at(surface: &Surface, triangle: usize, point: Vec3) -> Influences {
    weights_at(surface, triangle, parts_at(surface, triangle, point)).strongest()
}

fn weights_at(surface: &Surface, triangle: usize, parts: [f32; 3]) -> Weights {
    let mut weights = Weights::default();
    for (&vertex, &part) in surface.triangles[triangle].iter().zip(&parts) {
        weights.add(&surface.influences[vertex as usize], part);
    }
    weights
}

/// Barycentric coordinates, none below zero.
pub(super) fn parts_at(surface: &Surface, triangle: usize, point: Vec3) -> [f32; 3] {
    let corners = surface.triangles[triangle].map(|v| surface.positions[v as usize]);
    let parts = crate::barycentric(point, corners).map(|p| p.max(0.0));
    let sum: f32 = parts.iter().sum();
    parts.map(|p| p / sum)
}

/// The interpolated vertex normal.
fn normal_at(surface: &Surface, triangle: usize, parts: [f32; 3]) -> Vec3 {
    let corners = surface.triangles[triangle];
    let sum: Vec3 = corners.iter().zip(parts).map(|(&v, part)| surface.normals[v as usize] * part).sum();
    sum.normalize_or_zero()
}
