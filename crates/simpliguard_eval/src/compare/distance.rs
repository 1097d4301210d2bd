//! Distances between two surfaces.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use simpliguard::data::{TriMesh, bounds};
use simpliguard::geometry::Bvh;

/// Points on each surface.
const POINTS: usize = 50_000;

/// Distances between two surfaces, from points on each to the other, as fractions of the diagonal of the source's
/// bounding box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distances {
    /// Mean of the two mean distances.
    pub chamfer: f64,
    /// Largest distance.
    pub hausdorff: f64,
}

/// A source to measure levels against.
pub(crate) struct DistanceMetric {
    points: Vec<Vec3>,
    bvh: Bvh,
    diagonal: f64,
}

impl DistanceMetric {
    /// Samples a source; `None` on a surface without an area.
    pub(crate) fn new(source: &TriMesh) -> Option<Self> {
        let points = sample(source, POINTS);
        let (low, high) = bounds(&source.positions);
        let diagonal = f64::from(low.distance(high));
        let bvh = Bvh::new(&source.positions, &source.triangles);
        (!points.is_empty() && diagonal > 0.0).then_some(Self { points, bvh, diagonal })
    }

    /// The distances of a level; `None` if it has no area.
    pub(crate) fn measure(&self, level: &TriMesh) -> Option<Distances> {
        let points = sample(level, POINTS);
        if points.is_empty() {
            return None;
        }
        let bvh = Bvh::new(&level.positions, &level.triangles);
        let ways = [distances(&self.points, &bvh), distances(&points, &self.bvh)];
        let mean = |way: &[f64]| way.iter().sum::<f64>() / way.len() as f64;
        let chamfer = 0.5 * (mean(&ways[0]) + mean(&ways[1])) / self.diagonal;
        let hausdorff = ways.iter().flatten().copied().fold(0.0, f64::max) / self.diagonal;
        Some(Distances { chamfer, hausdorff })
    }
}

fn distances(points: &[Vec3], surface: &Bvh) -> Vec<f64> {
    let distance = |p: &Vec3| surface.closest(*p, f32::INFINITY).map_or(0.0, |hit| f64::from(hit.distance));
    points.par_iter().map(distance).collect()
}

/// `n` points on a surface, spread by area, the same ones each time; none if it has no area.
pub(crate) fn sample(mesh: &TriMesh, n: usize) -> Vec<Vec3> {
    let area = |t: usize| f64::from(mesh.area_vector(t).length());
    let total: f64 = (0..mesh.triangles.len()).map(area).sum();
    if !(total.is_finite() && total > 0.0) {
        return Vec::new();
    }
    let mut points = Vec::with_capacity(n);
    let mut sum = 0.0;
    for t in 0..mesh.triangles.len() {
        sum += area(t) * n as f64 / total;
        let [a, b, c] = mesh.corners(t);
        while points.len() < n && points.len() as f64 + 0.5 < sum {
            let [u, v] = spread(points.len());
            points.push(a + (b - a) * u + (c - a) * v);
        }
    }
    points
}

/// The R2 sequence (Roberts 2018), folded into a triangle.
fn spread(i: usize) -> [f32; 2] {
    let i = i as f64;
    let [u, v] = [0.754_877_666_246_693 * i, 0.569_840_290_998_053 * i].map(f64::fract);
    let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
    [u as f32, v as f32]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of side two at a height.
    fn plane(z: f32) -> TriMesh {
        let positions = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, z)).to_vec();
        TriMesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] }
    }

    #[test]
    fn parallel_planes_are_as_far_as_they_are_shifted() {
        let found = DistanceMetric::new(&plane(0.0)).and_then(|metric| metric.measure(&plane(0.3))).expect("surfaces");
        let expected = 0.3 / 8f64.sqrt();
        assert!((found.chamfer - expected).abs() < 1e-7 && (found.hausdorff - expected).abs() < 1e-7, "{found:?}");
    }

    #[test]
    fn a_missing_half_counts_in_one_direction() {
        let half = TriMesh { triangles: vec![[0, 1, 2]], ..plane(0.0) };
        let found = DistanceMetric::new(&plane(0.0)).and_then(|metric| metric.measure(&half)).expect("surfaces");
        // The farthest corner is half the diagonal off; the mean over its half is a third of that.
        assert!((found.hausdorff - 0.5).abs() < 0.01 && (found.chamfer - 0.5 / 3.0 / 4.0).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn nothing_has_no_distance() {
        assert!(DistanceMetric::new(&TriMesh::default()).is_none());
        assert!(DistanceMetric::new(&plane(0.0)).is_some_and(|metric| metric.measure(&TriMesh::default()).is_none()));
    }

    #[test]
    fn samples_are_spread_by_area() {
        let mut mesh = plane(0.0);
        mesh.append(&TriMesh { positions: plane(5.0).positions.iter().map(|p| *p * 0.5).collect(), ..plane(5.0) });
        let points = sample(&mesh, 1000);
        let large = points.iter().filter(|p| p.z == 0.0).count();
        assert!(points.len() == 1000 && large.abs_diff(800) <= 1, "{large}");
    }
}
