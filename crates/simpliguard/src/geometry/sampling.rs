//! Evenly spread directions.

use glam::Vec3;

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
