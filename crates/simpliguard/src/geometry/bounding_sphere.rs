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

    /// The smallest sphere around this one and another.
    pub fn with(&self, other: &Self) -> Self {
        let distance = self.centre.distance(other.centre);
        if distance + other.radius <= self.radius {
            return *self;
        }
        if distance + self.radius <= other.radius {
            return *other;
        }
        let radius = 0.5 * (distance + self.radius + other.radius);
        Self { centre: self.centre.lerp(other.centre, (radius - self.radius) / distance), radius }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_are_joined() {
        let sphere = |x: f32| BoundingSphere { centre: Vec3::X * x, radius: 1.0 };
        let both = sphere(0.0).with(&sphere(4.0));
        assert_eq!((both.centre, both.radius), (Vec3::X * 2.0, 3.0));
        assert_eq!((both.with(&sphere(1.0)), sphere(1.0).with(&both)), (both, both));
    }
}
