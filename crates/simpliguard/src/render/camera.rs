//! Cameras around a bounding sphere.

use glam::{Mat4, Quat, Vec3, Vec4};

use crate::mesh::bounds;

/// The sphere that a camera frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Centre of the bounding box.
    pub centre: Vec3,
    /// Distance of the farthest vertex from the centre; at least the smallest positive float.
    pub radius: f32,
}

impl Frame {
    /// The frame of a set of points.
    pub fn around(positions: &[Vec3]) -> Self {
        let (low, high) = bounds(positions);
        let centre = (low + high) * 0.5;
        let radius = positions.iter().map(|p| p.distance_squared(centre)).fold(0.0, f32::max).sqrt();
        Self { centre, radius: radius.max(f32::MIN_POSITIVE) }
    }
}

/// A perspective camera with a square image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// World to clip space, OpenGL conventions: y up, depth -1 to 1.
    pub view_projection: Mat4,
    /// Position in world space.
    pub eye: Vec3,
}

impl Camera {
    /// Looks along `-direction` at the frame, which fits the image `1 / margin` times, with a vertical field of view of `fov` radians.
    pub fn orbit(frame: &Frame, direction: Vec3, fov: f32, margin: f32) -> Self {
        let half = 0.5 * fov;
        let distance = frame.radius * margin / libm::sinf(half);
        let eye = frame.centre + direction * distance;
        let up = if direction.y.abs() > 0.99 { Vec3::X } else { Vec3::Y };
        let view = Mat4::look_to_rh(eye, -direction, up);
        let (near, far) = ((distance - 1.1 * frame.radius).max(distance * 1e-3), distance + 1.1 * frame.radius);
        Self { view_projection: perspective(libm::tanf(half), near, far) * view, eye }
    }

    /// Positions in clip space.
    pub fn project(&self, positions: &[Vec3]) -> Vec<Vec4> {
        positions.iter().map(|p| self.view_projection * p.extend(1.0)).collect()
    }
}

/// Perspective projection; `Mat4::perspective_rh_gl` takes its tangent from the platform, which may differ in the last bit.
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

/// `n` directions spread evenly over the sphere (spherical Fibonacci lattice).
pub fn fibonacci_directions(n: usize) -> Vec<Vec3> {
    let golden_angle = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    (0..n)
        .map(|i| {
            let y = 1.0 - 2.0 * (i as f32 + 0.5) / n as f32;
            let r = (1.0 - y * y).max(0.0).sqrt();
            let angle = i as f32 * golden_angle;
            Vec3::new(r * libm::cosf(angle), y, r * libm::sinf(angle))
        })
        .collect()
}

/// A small generator for jitter that must be the same everywhere (xorshift64*, Vigna 2016).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// Any seed will do.
    pub fn new(seed: u64) -> Self {
        Self(seed ^ 0x9E37_79B9_7F4A_7C15)
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        if self.0 == 0 {
            self.0 = 0x9E37_79B9_7F4A_7C15;
        }
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform over the unit quaternions (Shoemake 1992).
    pub fn rotation(&mut self) -> Quat {
        let (u, a, b) = (self.unit(), self.unit() * std::f32::consts::TAU, self.unit() * std::f32::consts::TAU);
        let (r, s) = ((1.0 - u).sqrt(), u.sqrt());
        Quat::from_xyzw(r * libm::sinf(a), r * libm::cosf(a), s * libm::sinf(b), s * libm::cosf(b)).normalize()
    }
}

/// `n` cameras around the frame: an evenly spread set of directions, turned at random, with field of view and distance
/// varied from view to view so that no single framing is fitted.
pub fn viewpoints(frame: &Frame, n: usize, seed: u64) -> Vec<Camera> {
    let mut random = Random::new(seed);
    let turn = random.rotation();
    fibonacci_directions(n)
        .into_iter()
        .map(|d| {
            let fov = (30.0 + 16.0 * random.unit()).to_radians();
            let margin = 1.0 + 0.12 * random.unit();
            Camera::orbit(frame, (turn * d).normalize(), fov, margin)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_fills_the_image() {
        let frame = Frame { centre: Vec3::new(1.0, 2.0, 3.0), radius: 2.0 };
        let camera = Camera::orbit(&frame, Vec3::Z, 0.7, 1.0);
        let centre = camera.project(&[frame.centre])[0];
        assert!((centre.x / centre.w).abs() < 1e-6 && (centre.y / centre.w).abs() < 1e-6);
        // The silhouette of a sphere touches the border where the tangent ray meets it.
        let tangent = frame.centre + 2.0 * Vec3::new(libm::cosf(0.35), 0.0, libm::sinf(0.35));
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
        let frame = Frame { centre: Vec3::ZERO, radius: 1.0 };
        assert_eq!(viewpoints(&frame, 8, 7), viewpoints(&frame, 8, 7));
        assert_ne!(viewpoints(&frame, 8, 7), viewpoints(&frame, 8, 8));
    }
}
