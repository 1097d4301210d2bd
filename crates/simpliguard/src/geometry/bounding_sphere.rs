//! Bounding spheres.

use glam::Vec3;

use crate::data::bounds;

/// The bounding sphere of a model, which cameras frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingSphere {
    /// Centre of the bounding box.
    pub centre: Vec3,
    /// Distance of the farthest vertex from the centre; at least the smallest positive float.
    pub radius: f32,
}

impl BoundingSphere {
    /// The bounding sphere of a set of points.
    pub fn around(positions: &[Vec3]) -> Self {
        let (low, high) = bounds(positions);
        let centre = (low + high) * 0.5;
        let radius = positions.iter().map(|p| p.distance_squared(centre)).fold(0.0, f32::max).sqrt();
        Self { centre, radius: radius.max(f32::MIN_POSITIVE) }
    }
}
