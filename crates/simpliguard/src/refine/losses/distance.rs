//! Distance to the source. Where colours hardly change, views say little about the depth of a surface. Without this term
//! vertices drift along the rays of the fitted views, and other views see it.

use glam::Vec3;
use rayon::prelude::*;

use crate::data::area_vector;
use crate::geometry::Bvh;
use crate::refine::low_poly::LowPoly;

/// Quadrature points on a face, in barycentric coordinates: exact for polynomials of the second degree (Strang and Fix
/// 1973).
const POINTS: [[f32; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

/// The tangent plane of the source at the point nearest to a point on a face.
#[derive(Clone, Copy, Default)]
struct Plane {
    normal: Vec3,
    point: Vec3,
    /// Fraction of the whole area that the point stands for.
    area: f32,
}

/// Mean squared distance of a mesh to the nearest tangent planes of the source.
pub(in crate::refine) struct SourceDistance<'a> {
    bvh: &'a Bvh,
    weight: f32,
    planes: Vec<[Plane; 3]>,
}

impl<'a> SourceDistance<'a> {
    /// With the planes nearest to `low` as it is.
    pub(in crate::refine) fn new(bvh: &'a Bvh, low: &LowPoly, weight: f32) -> Self {
        let mut distance = Self { bvh, weight, planes: Vec::new() };
        distance.find_planes(low);
        distance
    }

    pub(in crate::refine) fn set_weight(&mut self, weight: f32) {
        self.weight = weight;
    }

    /// Finds the planes nearest to `low` as it is.
    pub(in crate::refine) fn find_planes(&mut self, low: &LowPoly) {
        if self.weight == 0.0 {
            return;
        }
        let faces = low.triangles.len();
        let area = |t: usize| area_vector(low.corners(t)).length();
        let total: f32 = (0..faces).map(area).sum::<f32>().max(f32::MIN_POSITIVE);
        let planes = |t: usize| {
            POINTS.map(|weights| {
                let Some(hit) = self.bvh.closest(at(&low.corners(t), &weights), f32::INFINITY) else {
                    return Plane::default();
                };
                Plane { normal: self.bvh.normal(hit.triangle), point: hit.point, area: area(t) / (3.0 * total) }
            })
        };
        self.planes = (0..faces).into_par_iter().map(planes).collect();
    }

    /// Adds the gradient of the weighted mean, for fixed planes; returns that loss.
    pub(in crate::refine) fn add_gradient(&self, low: &LowPoly, gradient: &mut [Vec3]) -> f64 {
        let mut loss = 0.0;
        for (t, (triangle, planes)) in low.triangles.iter().zip(&self.planes).enumerate() {
            let corners = low.corners(t);
            for (plane, weights) in planes.iter().zip(&POINTS) {
                let distance = (at(&corners, weights) - plane.point).dot(plane.normal);
                loss += f64::from(self.weight * plane.area * distance * distance);
                let g = plane.normal * (2.0 * self.weight * plane.area * distance);
                for (v, share) in triangle.iter().zip(weights) {
                    gradient[*v as usize] += g * *share;
                }
            }
        }
        loss
    }
}

/// The point of a triangle with these barycentric coordinates.
fn at([a, b, c]: &[Vec3; 3], [u, v, w]: &[f32; 3]) -> Vec3 {
    *a * *u + *b * *v + *c * *w
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Atlas, TriMesh};
    use crate::refine::TexelGrid;

    fn floor() -> Bvh {
        Bvh::new(&[Vec3::new(-9.0, -9.0, 0.0), Vec3::new(9.0, -9.0, 0.0), Vec3::new(0.0, 9.0, 0.0)], &[[0, 1, 2]])
    }

    fn triangle(heights: [f32; 3]) -> LowPoly {
        let [a, b, c] = heights;
        let positions = vec![Vec3::new(0.0, 0.1, a), Vec3::new(1.0, 0.0, b), Vec3::new(0.3, 1.0, c)];
        let atlas = Atlas { uvs: vec![Default::default()], ..Atlas::default() };
        LowPoly::new(&TriMesh { positions, triangles: vec![[0, 1, 2]] }, &atlas, false, TexelGrid::empty())
    }

    #[test]
    fn a_parallel_triangle_is_as_far_as_it_is_high() {
        let (bvh, low) = (floor(), triangle([0.5; 3]));
        let mut gradient = [Vec3::ZERO; 3];
        let loss = SourceDistance::new(&bvh, &low, 2.0).add_gradient(&low, &mut gradient);
        assert!((loss - 0.5).abs() < 1e-6);
        assert!(gradient.iter().all(|g| g.abs_diff_eq(Vec3::Z * 2.0 / 3.0, 1e-6)), "{gradient:?}");
    }

    #[test]
    fn the_gradient_matches_central_differences() {
        let (bvh, mut low) = (floor(), triangle([0.5, -0.2, 0.9]));
        let distance = SourceDistance::new(&bvh, &low, 0.7);
        let mut gradient = [Vec3::ZERO; 3];
        distance.add_gradient(&low, &mut gradient);
        for (v, gradient) in gradient.iter().enumerate() {
            for (axis, gradient) in gradient.to_array().into_iter().enumerate() {
                let h = 1e-2;
                let mut at = |x: f32| {
                    low.positions[v][axis] += x;
                    let loss = distance.add_gradient(&low, &mut [Vec3::ZERO; 3]);
                    low.positions[v][axis] -= x;
                    loss
                };
                let difference = (at(h) - at(-h)) / (2.0 * f64::from(h));
                assert!((difference - f64::from(gradient)).abs() < 1e-4);
            }
        }
    }
}
