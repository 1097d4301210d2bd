//! Boxes around points, along axes of their own.

use std::f32::consts::FRAC_PI_2;

use glam::{Mat3, Vec3};

use crate::data::{TriMesh, bounds};

/// Least thickness of a box, as a fraction of half its length: a card always has an area, and reaches a little.
const LEAST: f32 = 0.02;
/// Rotations of a rectangle that are tried.
const ROTATIONS: u32 = 90;

/// A box around points, along their principal axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct OrientedBox {
    /// Orthonormal and right-handed.
    pub(super) axes: Mat3,
    pub(super) centre: Vec3,
    /// Half extents along the axes. The variance of the points falls from axis to axis.
    pub(super) half: Vec3,
}

impl OrientedBox {
    /// The box along the principal axes.
    pub(super) fn around(points: &[Vec3]) -> Self {
        Self::along(principal_axes(covariance(points)), points)
    }

    /// The box of least extent across `normal`, whose middle plane goes through `centre`.
    pub(super) fn across(normal: Vec3, centre: Vec3, points: &[Vec3]) -> Self {
        let (x, y) = normal.any_orthonormal_pair();
        let around = Self::along(Mat3::from_cols(x, y, normal), points).turned(points);
        let offset = (centre - around.centre).dot(normal);
        let half = Vec3 { z: around.half.z + offset.abs(), ..around.half };
        Self { centre: around.centre + normal * offset, half, ..around }
    }

    fn along(axes: Mat3, points: &[Vec3]) -> Self {
        let local: Vec<Vec3> = points.iter().map(|p| axes.transpose() * *p).collect();
        let (low, high) = bounds(&local);
        Self { axes, centre: axes * ((low + high) * 0.5), half: (high - low) * 0.5 }
    }

    /// The box around the same points, turned around its last axis to the least area: the principal axes of a square are
    /// arbitrary.
    pub(super) fn turned(self, points: &[Vec3]) -> Self {
        let turn = |i: u32| {
            let (sin, cos) = libm::sincosf(FRAC_PI_2 * i as f32 / ROTATIONS as f32);
            let Mat3 { x_axis: x, y_axis: y, z_axis: z } = self.axes;
            Self::along(Mat3::from_cols(x * cos + y * sin, y * cos - x * sin, z), points)
        };
        let turned = (0..ROTATIONS).map(turn);
        turned.min_by(|a, b| a.area().total_cmp(&b.area())).unwrap_or(self)
    }

    /// Area of the rectangle across the last axis.
    pub(super) fn area(&self) -> f32 {
        4.0 * self.half.x * self.half.y
    }

    /// Adds the rectangle across the last axis to a mesh. Returns the reach of the box to either side of it.
    pub(super) fn add_rectangle(&self, mesh: &mut TriMesh) -> f32 {
        let Self { axes, centre, half } = *self;
        let least = half.x.max(f32::MIN_POSITIVE) * LEAST;
        let (u, v) = (axes.x_axis * half.x.max(least), axes.y_axis * half.y.max(least));
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([centre - u - v, centre + u - v, centre + u + v, centre - u + v]);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        half.z.max(least)
    }
}

/// The covariance of points, times their number.
fn covariance(points: &[Vec3]) -> Mat3 {
    let mean = points.iter().sum::<Vec3>() / points.len().max(1) as f32;
    let mut a = Mat3::ZERO;
    for d in points.iter().map(|p| *p - mean) {
        a += Mat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    a
}

/// Orthonormal, right-handed eigenvectors of a symmetric matrix, by falling eigenvalues (Jacobi's method).
pub(super) fn principal_axes(mut a: Mat3) -> Mat3 {
    let mut axes = Mat3::IDENTITY;
    for _ in 0..8 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a.col(p)[q];
            if off == 0.0 {
                continue;
            }
            let theta = (a.col(q)[q] - a.col(p)[p]) / (2.0 * off);
            let t = if theta < 0.0 { -1.0 } else { 1.0 } / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let mut rotation = Mat3::IDENTITY;
            rotation.col_mut(p)[p] = c;
            rotation.col_mut(q)[q] = c;
            rotation.col_mut(p)[q] = -t * c;
            rotation.col_mut(q)[p] = t * c;
            a = rotation.transpose() * a * rotation;
            axes *= rotation;
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a.col(j)[j].total_cmp(&a.col(i)[i]).then(i.cmp(&j)));
    let (x, y) = (axes.col(order[0]).normalize_or(Vec3::X), axes.col(order[1]).normalize_or(Vec3::Y));
    Mat3::from_cols(x, y, x.cross(y))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corners of a slab of 4 x 2 x 0.5, turned.
    fn slab() -> Vec<Vec3> {
        let turn = glam::Quat::from_xyzw(0.2, 0.4, 0.1, 0.8).normalize();
        (0..8)
            .map(|i| turn * Vec3::new((i & 1) as f32 * 4.0, (i >> 1 & 1) as f32 * 2.0, (i >> 2) as f32 * 0.5))
            .collect()
    }

    #[test]
    fn a_box_follows_a_turned_slab() {
        let half = OrientedBox::around(&slab()).half;
        assert!((half - Vec3::new(2.0, 1.0, 0.25)).length() < 1e-4, "{half}");
    }

    #[test]
    fn a_rectangle_covers_its_points_and_knows_their_depth() {
        let mut mesh = TriMesh::default();
        let reach = OrientedBox::around(&slab()).add_rectangle(&mut mesh);
        let area: f32 = (0..2).map(|t| mesh.area_vector(t).length() * 0.5).sum();
        assert!((area - 8.0).abs() < 1e-3 && (reach - 0.25).abs() < 1e-4, "{area} {reach}");
    }

    #[test]
    fn a_square_is_turned_to_its_sides() {
        let points = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y];
        let turned = OrientedBox::along(Mat3::IDENTITY, &points).turned(&points);
        assert!((turned.area() - 2.0).abs() < 1e-4, "{turned:?}");
    }
}
