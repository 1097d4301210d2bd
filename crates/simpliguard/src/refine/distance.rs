//! Distance to the source. Pictures say little of how far away a surface is whose colours hardly change: without this
//! term vertices drift until the views that are fitted cannot tell, and others can.

use glam::Vec3;
use rayon::prelude::*;

use crate::Bvh;

/// Points on a face, by barycentric coordinates: exact for polynomials of the second degree (Strang and Fix 1973).
const POINTS: [[f32; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

/// The tangent plane of the source next to a point on a face.
#[derive(Clone, Copy, Default)]
struct Plane {
    normal: Vec3,
    point: Vec3,
    /// Part of the whole area that the point stands for.
    area: f32,
}

/// Mean squared distance of a mesh to the planes of the source next to it.
pub(super) struct SourceDistance(Vec<[Plane; 3]>);

impl SourceDistance {
    /// Finds the planes next to the mesh as it is.
    pub(super) fn new(bvh: &Bvh, positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize]);
        let area = |t: &[u32; 3]| {
            let [a, b, c] = corners(t);
            (b - a).cross(c - a).length()
        };
        let total: f32 = triangles.iter().map(area).sum::<f32>().max(f32::MIN_POSITIVE);
        let planes = |t: &[u32; 3]| {
            POINTS.map(|weights| {
                let hit = bvh.closest(at(&corners(t), &weights), f32::INFINITY);
                let area = area(t) / (3.0 * total);
                hit.map_or_else(Plane::default, |hit| Plane {
                    normal: bvh.normal(hit.triangle),
                    point: hit.point,
                    area,
                })
            })
        };
        Self(triangles.par_iter().map(planes).collect())
    }

    /// Adds the gradient of `weight` times the mean; returns that loss.
    pub(super) fn add_gradient(
        &self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        weight: f32,
        gradient: &mut [Vec3],
    ) -> f64 {
        let mut loss = 0.0;
        for (triangle, planes) in triangles.iter().zip(&self.0) {
            let corners = triangle.map(|v| positions[v as usize]);
            for (plane, weights) in planes.iter().zip(&POINTS) {
                let distance = (at(&corners, weights) - plane.point).dot(plane.normal);
                loss += f64::from(weight * plane.area * distance * distance);
                let g = plane.normal * (2.0 * weight * plane.area * distance);
                for (v, part) in triangle.iter().zip(weights) {
                    gradient[*v as usize] += g * *part;
                }
            }
        }
        loss
    }
}

fn at([a, b, c]: &[Vec3; 3], [u, v, w]: &[f32; 3]) -> Vec3 {
    *a * *u + *b * *v + *c * *w
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The floor z = 0, and a triangle over it.
    fn over_floor(triangle: [Vec3; 3]) -> (SourceDistance, Vec<Vec3>) {
        let floor = [Vec3::new(-9.0, -9.0, 0.0), Vec3::new(9.0, -9.0, 0.0), Vec3::new(0.0, 9.0, 0.0)];
        let positions = triangle.to_vec();
        (SourceDistance::new(&Bvh::new(&floor, &[[0, 1, 2]]), &positions, &[[0, 1, 2]]), positions)
    }

    #[test]
    fn a_parallel_triangle_is_as_far_as_it_is_high() {
        let (distance, positions) =
            over_floor([Vec3::new(0.0, 0.0, 0.5), Vec3::new(1.0, 0.0, 0.5), Vec3::new(0.0, 1.0, 0.5)]);
        let mut gradient = [Vec3::ZERO; 3];
        let loss = distance.add_gradient(&positions, &[[0, 1, 2]], 2.0, &mut gradient);
        assert!((loss - 0.5).abs() < 1e-6);
        assert!(gradient.iter().all(|g| g.abs_diff_eq(Vec3::Z * 2.0 / 3.0, 1e-6)), "{gradient:?}");
    }

    #[test]
    fn the_gradient_matches_central_differences() {
        let (distance, mut positions) =
            over_floor([Vec3::new(0.0, 0.1, 0.5), Vec3::new(1.0, 0.0, -0.2), Vec3::new(0.3, 1.0, 0.9)]);
        let mut gradient = [Vec3::ZERO; 3];
        distance.add_gradient(&positions, &[[0, 1, 2]], 0.7, &mut gradient);
        for v in 0..3 {
            for axis in 0..3 {
                let h = 1e-2;
                let mut at = |x: f32| {
                    positions[v][axis] += x;
                    let loss = distance.add_gradient(&positions, &[[0, 1, 2]], 0.7, &mut [Vec3::ZERO; 3]);
                    positions[v][axis] -= x;
                    loss
                };
                let difference = (at(h) - at(-h)) / (2.0 * f64::from(h));
                assert!((difference - f64::from(gradient[v][axis])).abs() < 1e-4);
            }
        }
    }
}
