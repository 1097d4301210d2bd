//! Influences at points of the source's surface.

use glam::Vec3;
use rayon::prelude::*;

use super::Weights;
use crate::data::{Influences, Surface};
use crate::geometry::Bvh;

/// The closest point's influences for each position, whatever its distance.
pub(crate) fn closest_influences(surface: &Surface, bvh: &Bvh, positions: &[Vec3]) -> Vec<Influences> {
    let closest = |&position: &Vec3| {
        let hit = bvh.closest(position, f32::INFINITY);
        hit.map_or(Influences::rigid(0), |hit| influences_at(surface, hit.triangle as usize, hit.point))
    };
    positions.par_iter().with_min_len(1024).map(closest).collect()
}

/// Influences at a point of a triangle.
pub(crate) fn influences_at(surface: &Surface, triangle: usize, point: Vec3) -> Influences {
    weights_at(surface, triangle, corner_weights(surface, triangle, point)).strongest()
}

/// Weights at barycentric coordinates of a triangle.
pub(crate) fn weights_at(surface: &Surface, triangle: usize, parts: [f32; 3]) -> Weights {
    let mut weights = Weights::default();
    for (&vertex, &part) in surface.triangles[triangle].iter().zip(&parts) {
        weights.add(&surface.influences[vertex as usize], part);
    }
    weights
}

/// Barycentric coordinates, none below zero.
pub(crate) fn corner_weights(surface: &Surface, triangle: usize, point: Vec3) -> [f32; 3] {
    let corners = surface.triangles[triangle].map(|v| surface.positions[v as usize]);
    let parts = crate::geometry::barycentric(point, corners).map(|p| p.max(0.0));
    let sum: f32 = parts.iter().sum();
    parts.map(|p| p / sum)
}
