//! The conditions of a valid flat chart: no flip, no overlap, limited stretch.

use glam::DVec2;

use super::chart::Chart;
use super::half_edge_mesh::HalfEdgeMesh;
use crate::geometry::doubled_area;

/// Least area of a face in its chart as a fraction of its area on the surface.
const LEAST_AREA: f64 = 0.05;

/// Least height of a face in its chart as a fraction of its longest side there.
const LEAST_ASPECT: f64 = 1e-3;

/// Largest L2 stretch of a flat chart (Sander et al. 2001); 1 allows isometric charts only.
#[derive(Clone, Copy)]
pub(super) struct StretchLimit(pub f64);

/// Scales `uv` to the chart's area on the surface and measures its L2 stretch; `None` if it has no area.
pub(super) fn even_out(mesh: &HalfEdgeMesh, chart: &Chart, uv: &mut [DVec2]) -> Option<f64> {
    let (mut laid, mut area) = (0.0, 0.0);
    for (i, &f) in chart.faces.iter().enumerate() {
        laid += 0.5 * doubled_area(&chart.triangle(uv, i));
        area += mesh.area[f as usize];
    }
    let scale = (area / laid).sqrt();
    if !scale.is_finite() || scale <= 0.0 {
        return None;
    }
    uv.iter_mut().for_each(|p| *p *= scale);
    Some((stretch_energy(mesh, chart, uv) / area).sqrt())
}

/// Sum over faces of `area (s1^2 + s2^2) / 2`, where `s1, s2` are the singular values of the map from the texture to
/// the surface (Sander et al. 2001); infinite where a face has no area.
pub(super) fn stretch_energy(mesh: &HalfEdgeMesh, chart: &Chart, uv: &[DVec2]) -> f64 {
    let energy = |(i, &f): (usize, &u32)| {
        let f = f as usize;
        mesh.area[f] * l2_squared(&chart.triangle(uv, i), &mesh.flat[f])
    };
    chart.faces.iter().enumerate().map(energy).sum()
}

/// The largest singular value of the map from the texture to the surface (Sander et al. 2001), over the faces; infinite
/// where a face has no area.
pub(super) fn worst_stretch(mesh: &HalfEdgeMesh, chart: &Chart, uv: &[DVec2]) -> f64 {
    let largest = |(i, &f): (usize, &u32)| linf_squared(&chart.triangle(uv, i), &mesh.flat[f as usize]);
    chart.faces.iter().enumerate().map(largest).fold(0.0, f64::max).sqrt()
}

/// Half the squared Frobenius norm of the map from `t` to `z`.
fn l2_squared(t: &[DVec2; 3], z: &[DVec2; 3]) -> f64 {
    derivatives(t, z).map_or(f64::INFINITY, |[u, v]| 0.5 * (u.length_squared() + v.length_squared()))
}

/// The squared spectral norm of the map from `t` to `z`.
fn linf_squared(t: &[DVec2; 3], z: &[DVec2; 3]) -> f64 {
    derivatives(t, z).map_or(f64::INFINITY, |[u, v]| {
        let (a, b, c) = (u.length_squared(), u.dot(v), v.length_squared());
        0.5 * (a + c + ((a - c) * (a - c) + 4.0 * b * b).sqrt())
    })
}

/// Derivatives of the map from `t` to `z` along both axes; `None` if `t` has no area or is flipped.
fn derivatives(t: &[DVec2; 3], z: &[DVec2; 3]) -> Option<[DVec2; 2]> {
    let doubled = doubled_area(t);
    let along_x = z[0] * (t[1].y - t[2].y) + z[1] * (t[2].y - t[0].y) + z[2] * (t[0].y - t[1].y);
    let along_y = z[0] * (t[2].x - t[1].x) + z[1] * (t[0].x - t[2].x) + z[2] * (t[1].x - t[0].x);
    (doubled > 0.0).then(|| [along_x, along_y].map(|d| d / doubled))
}

/// True if the scaled map is injective: every triangle is counter-clockwise, and the boundary does not cross itself.
/// Both together suffice for a disc. The triangles must keep an area and a height with a margin.
pub(super) fn is_valid(mesh: &HalfEdgeMesh, chart: &Chart, boundary: &[u32], uv: &[DVec2]) -> bool {
    let sound = |(i, &f): (usize, &u32)| {
        let t = chart.triangle(uv, i);
        let longest = (0..3).map(|k| t[k].distance_squared(t[(k + 1) % 3])).fold(0.0, f64::max);
        let doubled = doubled_area(&t);
        doubled >= 2.0 * LEAST_AREA * mesh.area[f as usize] && doubled >= LEAST_ASPECT * longest
    };
    chart.faces.iter().enumerate().all(sound) && !crosses_itself(boundary.iter().map(|&v| uv[v as usize]).collect())
}

/// True if two sides of a closed polygon meet other than at a common corner.
fn crosses_itself(polygon: Vec<DVec2>) -> bool {
    let n = polygon.len();
    let side = |i: usize| [polygon[i], polygon[(i + 1) % n]];
    let mut sides: Vec<(f64, f64, usize)> = (0..n)
        .map(|i| {
            let [a, b] = side(i);
            (a.x.min(b.x), a.x.max(b.x), i)
        })
        .collect();
    sides.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    for (at, &(_, right, i)) in sides.iter().enumerate() {
        for &(_, _, j) in sides[at + 1..].iter().take_while(|s| s.0 <= right) {
            let adjacent = (i + 1) % n == j || (j + 1) % n == i;
            if !adjacent && meet(side(i), side(j)) {
                return true;
            }
        }
    }
    false
}

/// True if two segments share a point; touching counts.
fn meet(a: [DVec2; 2], b: [DVec2; 2]) -> bool {
    let apart = |k: usize| a[0][k].max(a[1][k]) < b[0][k].min(b[1][k]) || b[0][k].max(b[1][k]) < a[0][k].min(a[1][k]);
    if apart(0) || apart(1) {
        return false;
    }
    let same_side = |s: [DVec2; 2], t: [DVec2; 2]| {
        let d = s[1] - s[0];
        d.perp_dot(t[0] - s[0]) * d.perp_dot(t[1] - s[0]) > 0.0
    };
    !same_side(a, b) && !same_side(b, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(points: &[[f64; 2]]) -> Vec<DVec2> {
        points.iter().map(|&p| p.into()).collect()
    }

    #[test]
    fn a_square_is_simple_and_a_bow_tie_is_not() {
        assert!(!crosses_itself(polygon(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])));
        assert!(crosses_itself(polygon(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])));
    }

    #[test]
    fn a_corner_that_touches_another_side_counts_as_overlap() {
        assert!(crosses_itself(polygon(&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 0.0], [0.0, 1.0]])));
    }

    #[test]
    fn stretch_of_scaling_and_shear_is_exact() {
        let z = [DVec2::ZERO, DVec2::X, DVec2::Y];
        assert_eq!(l2_squared(&z, &z), 1.0);
        assert_eq!(l2_squared(&z.map(|p| 2.0 * p), &z), 0.25);
        assert_eq!(l2_squared(&z.map(|p| p * DVec2::new(0.5, 1.0)), &z), 2.5);
        assert_eq!(l2_squared(&[z[0], z[2], z[1]], &z), f64::INFINITY);
        assert_eq!(linf_squared(&z.map(|p| 2.0 * p), &z), 0.25);
        assert_eq!(linf_squared(&z.map(|p| p * DVec2::new(0.5, 1.0)), &z), 4.0);
        assert_eq!(linf_squared(&[z[0], z[2], z[1]], &z), f64::INFINITY);
    }
}
