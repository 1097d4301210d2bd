//! Influences at points of the source's surface.

use glam::Vec3;
use rayon::prelude::*;

use super::weights::Weights;
use crate::data::{Influences, Surface};
use crate::geometry::{Bvh, clamped_barycentric};

/// The influences at the closest point of the surface, for each position. The distance has no limit.
pub(crate) fn closest_influences(surface: &Surface, bvh: &Bvh, positions: &[Vec3]) -> Vec<Influences> {
    let closest = |&position: &Vec3| {
        let hit = bvh.closest(position, f32::INFINITY);
        hit.map_or(Influences::rigid(0), |hit| influences_at(surface, hit.triangle as usize, hit.point))
    };
    positions.par_iter().with_min_len(1024).map(closest).collect()
}

/// The influences at a point of a triangle.
pub(crate) fn influences_at(surface: &Surface, triangle: usize, point: Vec3) -> Influences {
    weights_at(surface, triangle, corner_weights(surface, triangle, point)).strongest()
}

/// The weights at the point of a triangle with these barycentric coordinates.
pub(crate) fn weights_at(surface: &Surface, triangle: usize, barycentric: [f32; 3]) -> Weights {
    let mut weights = Weights::default();
    for (&vertex, &factor) in surface.triangles[triangle].iter().zip(&barycentric) {
        weights.add(&surface.influences[vertex as usize], factor);
    }
    weights
}

/// The barycentric coordinates of a point of a triangle, none below zero.
pub(crate) fn corner_weights(surface: &Surface, triangle: usize, point: Vec3) -> [f32; 3] {
    clamped_barycentric(point, surface.triangles[triangle].map(|v| surface.positions[v as usize]))
}
