//! Distances between a level and the visible surface of its source.

use glam::Vec3;
use rayon::prelude::*;

use super::opaque::OpaqueSurface;
use crate::Cancellation;
use crate::data::{Deviation, TriMesh, bounds};
use crate::geometry::{Bvh, fibonacci_directions};

/// Approximate number of points on each surface.
const POINTS: usize = 8192;
/// Rays that decide if a point of the source is visible.
const RAYS: usize = 16;

/// Measures levels against one source.
pub struct DeviationMetric<'a> {
    opaque: &'a OpaqueSurface,
    diagonal: f32,
    /// Visible points of the source.
    points: Vec<Vec3>,
}

impl<'a> DeviationMetric<'a> {
    /// Samples the source and keeps the visible points; fewer if cancelled.
    pub fn new(opaque: &'a OpaqueSurface, cancellation: &Cancellation) -> Self {
        let (low, high) = bounds(&opaque.mesh.positions);
        let diagonal = low.distance(high).max(f32::MIN_POSITIVE);
        let directions = fibonacci_directions(2 * RAYS);
        let is_visible = |(p, n): &(Vec3, Vec3)| {
            let lift = 1e-4 * diagonal;
            let mut directions = directions.iter().take_while(|_| !cancellation.is_cancelled());
            directions.any(|&d| {
                let side = if d.dot(*n) < 0.0 { -*n } else { *n };
                d.dot(side) > 0.1 && !opaque.bvh.occluded(*p + side * lift, d, 2.0 * diagonal)
            })
        };
        let all = points(&opaque.mesh, POINTS);
        Self { opaque, diagonal, points: all.into_par_iter().filter(is_visible).map(|(p, _)| p).collect() }
    }

    /// The diagonal of the source's bounding box.
    pub fn diagonal(&self) -> f32 {
        self.diagonal
    }

    /// Distances from the level to the source and from the visible source to the level, as fractions of the diagonal of
    /// the source's bounding box.
    pub fn measure(&self, level: &TriMesh) -> Deviation {
        let bvh = Bvh::new(&level.positions, &level.triangles);
        let distance =
            |bvh: &Bvh, p: Vec3| bvh.closest(p, f32::INFINITY).map_or(0.0, |hit| hit.distance / self.diagonal);
        let mut distances: Vec<f32> =
            points(level, POINTS).par_iter().map(|(p, _)| distance(&self.opaque.bvh, *p)).collect();
        let from_source: Vec<f32> = self.points.par_iter().map(|p| distance(&bvh, *p)).collect();
        distances.extend(from_source);
        distances.sort_by(f32::total_cmp);
        let Some(&max) = distances.last() else { return Deviation::default() };
        let mean = (distances.iter().map(|&d| f64::from(d)).sum::<f64>() / distances.len() as f64) as f32;
        Deviation { mean, percentile_95: distances[(distances.len() - 1) * 95 / 100], max }
    }
}

/// About `n` points on a surface, spread by area, with the unit normals of their faces.
fn points(mesh: &TriMesh, n: usize) -> Vec<(Vec3, Vec3)> {
    let area = |t: usize| f64::from(mesh.area_vector(t).length());
    let total: f64 = (0..mesh.triangles.len()).map(area).sum();
    let mut out = Vec::with_capacity(n + 1);
    let mut due = 0.5;
    let mut sum = 0.0;
    for t in 0..mesh.triangles.len() {
        sum += area(t) * n as f64 / total.max(f64::MIN_POSITIVE);
        let [a, b, c] = mesh.corners(t);
        let normal = mesh.area_vector(t).normalize_or_zero();
        while due < sum {
            // The R2 sequence (Roberts 2018), folded into the triangle.
            let i = out.len() as f32;
            let (mut u, mut v) = ((0.754_877_7 * i).fract(), (0.569_840_3 * i).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            out.push((a + (b - a) * u + (c - a) * v, normal));
            due += 1.0;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spread_by_area() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, 3.0 * Vec3::X, 3.0 * Vec3::Y];
        let mesh = TriMesh { positions, triangles: vec![[0, 1, 2], [0, 3, 4]] };
        let all = points(&mesh, 1000);
        assert!(all.len().abs_diff(1000) <= 1);
        let small = all.iter().filter(|(p, _)| p.x + p.y <= 1.0).count();
        // A tenth on the small one, and a ninth of the rest where the large one covers it.
        assert!(small.abs_diff(200) < 20, "{small}");
    }
}
