//! Cameras around a bounding sphere.

use glam::{Mat4, Vec3, Vec4};

use crate::geometry::{BoundingSphere, Random, fibonacci_directions};

/// A perspective camera with a square image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// World to clip space, OpenGL conventions: y up, depth -1 to 1.
    pub view_projection: Mat4,
    /// Position in world space.
    pub eye: Vec3,
}

impl Camera {
    /// A camera that looks along `-direction` at the centre of a sphere, with a vertical field of view of `fov`
    /// radians. The sphere takes up `1 / margin` of the image.
    pub fn orbit(sphere: &BoundingSphere, direction: Vec3, fov: f32, margin: f32) -> Self {
        let half = 0.5 * fov;
        let distance = sphere.radius * margin / libm::sinf(half);
        let eye = sphere.centre + direction * distance;
        let up = if direction.y.abs() > 0.99 { Vec3::X } else { Vec3::Y };
        let view = Mat4::look_to_rh(eye, -direction, up);
        let (near, far) = ((distance - 1.1 * sphere.radius).max(distance * 1e-3), distance + 1.1 * sphere.radius);
        Self { view_projection: perspective(libm::tanf(half), near, far) * view, eye }
    }

    /// Positions in clip space.
    pub fn project(&self, positions: &[Vec3]) -> Vec<Vec4> {
        let mut clip = Vec::new();
        self.project_into(positions, &mut clip);
        clip
    }

    /// Replaces `clip` by positions in clip space.
    pub fn project_into(&self, positions: &[Vec3], clip: &mut Vec<Vec4>) {
        clip.clear();
        clip.extend(positions.iter().map(|p| self.view_projection * p.extend(1.0)));
    }
}

/// Perspective projection. `Mat4::perspective_rh_gl` takes its tangent from the platform; that may differ in the last
/// bit.
fn perspective(tan_half: f32, near: f32, far: f32) -> Mat4 {
    let f = 1.0 / tan_half;
    let depth = 1.0 / (near - far);
    Mat4::from_cols(
        Vec4::new(f, 0.0, 0.0, 0.0),
        Vec4::new(0.0, f, 0.0, 0.0),
        Vec4::new(0.0, 0.0, (near + far) * depth, -1.0),
        Vec4::new(0.0, 0.0, 2.0 * near * far * depth, 0.0),
    )
}

/// `n` cameras around a sphere, in evenly spread directions that are rotated at random. Field of view and distance
/// vary, so that nothing is fitted to a single framing.
pub fn viewpoints(sphere: &BoundingSphere, n: usize, seed: u64) -> Vec<Camera> {
    let mut random = Random::new(seed);
    let turn = random.rotation();
    fibonacci_directions(n)
        .into_iter()
        .map(|d| {
            let fov = (30.0 + 16.0 * random.unit()).to_radians();
            let margin = 1.0 + 0.12 * random.unit();
            Camera::orbit(sphere, (turn * d).normalize(), fov, margin)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_fills_the_image() {
        let sphere = BoundingSphere { centre: Vec3::new(1.0, 2.0, 3.0), radius: 2.0 };
        let camera = Camera::orbit(&sphere, Vec3::Z, 0.7, 1.0);
        let centre = camera.project(&[sphere.centre])[0];
        assert!((centre.x / centre.w).abs() < 1e-6 && (centre.y / centre.w).abs() < 1e-6);
        // The silhouette of the sphere touches the border of the image.
        let tangent = sphere.centre + 2.0 * Vec3::new(libm::cosf(0.35), 0.0, libm::sinf(0.35));
        let edge = camera.project(&[tangent])[0];
        assert!((edge.x / edge.w - 1.0).abs() < 1e-5, "{}", edge.x / edge.w);
    }

    #[test]
    fn directions_are_unit_and_balanced() {
        let directions = fibonacci_directions(80);
        assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-5));
        assert!(directions.iter().sum::<Vec3>().length() < 1.0);
    }

    #[test]
    fn equal_seeds_give_equal_cameras() {
        let sphere = BoundingSphere { centre: Vec3::ZERO, radius: 1.0 };
        assert_eq!(viewpoints(&sphere, 8, 7), viewpoints(&sphere, 8, 7));
        assert_ne!(viewpoints(&sphere, 8, 7), viewpoints(&sphere, 8, 8));
    }
}
