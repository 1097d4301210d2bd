//! Points, rays and areas of single triangles.

use glam::{DVec2, DVec3, Vec3, Vec3A};

/// The normal of a triangle times twice its area, in double precision; [`crate::data::TriMesh::area_vector`] is the one
/// in single precision.
pub(crate) fn area_vector(&[a, b, c]: &[DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// Twice the signed area of a triangle in the plane; positive if it runs counter-clockwise with y up.
pub(crate) fn doubled_area(&[a, b, c]: &[DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a)
}

/// The point of a triangle nearest to `p` (Ericson 2005, 5.1.5). Degenerate triangles give a point of one of their
/// edges.
pub fn closest_point(p: Vec3A, &[a, b, c]: &[Vec3A; 3]) -> Vec3A {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 && (d4 - d3) + (d5 - d6) > 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum.abs() < 1e-30 { a } else { a + ab * (vb / sum) + ac * (vc / sum) }
}

/// Barycentric coordinates of a point in the plane of a triangle; thirds for a triangle without area.
pub fn barycentric(p: Vec3, [a, b, c]: [Vec3; 3]) -> [f32; 3] {
    let n = (b - a).cross(c - a);
    let area = n.length_squared();
    if area <= f32::MIN_POSITIVE {
        return [1.0 / 3.0; 3];
    }
    let u = (c - b).cross(p - b).dot(n) / area;
    let v = (a - c).cross(p - c).dot(n) / area;
    [u, v, 1.0 - u - v]
}

/// As [`barycentric`], with negative coordinates raised to zero and the sum scaled back to one.
pub(crate) fn clamped_barycentric(p: Vec3, corners: [Vec3; 3]) -> [f32; 3] {
    let coordinates = barycentric(p, corners).map(|coordinate| coordinate.max(0.0));
    let sum: f32 = coordinates.iter().sum();
    coordinates.map(|coordinate| coordinate / sum)
}

/// Distance along a ray to a triangle, in units of the direction (Möller and Trumbore 1997); both sides count.
pub(super) fn ray_distance(origin: Vec3A, direction: Vec3A, &[a, b, c]: &[Vec3A; 3]) -> Option<f32> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let det = e1.dot(p);
    if det == 0.0 {
        return None;
    }
    let inv = 1.0 / det;
    let s = origin - a;
    let u = s.dot(p) * inv;
    let q = s.cross(e1);
    let v = direction.dot(q) * inv;
    if !(u >= 0.0 && v >= 0.0 && u + v <= 1.0) {
        return None;
    }
    Some(e2.dot(q) * inv)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_that_is_an_edge_has_a_closest_point() {
        let triangle = [Vec3A::ONE, Vec3A::ONE, Vec3A::ZERO];
        for (p, closest) in
            [(Vec3A::ZERO, Vec3A::ZERO), (2.0 * Vec3A::ONE, Vec3A::ONE), (Vec3A::X * 1.5, Vec3A::splat(0.5))]
        {
            for turn in 0..3 {
                let turned = [0, 1, 2].map(|k| triangle[(k + turn) % 3]);
                assert!(closest_point(p, &turned).distance(closest) < 1e-6, "{p} {turn}");
            }
        }
    }

    #[test]
    fn barycentric_coordinates_are_clamped_outside_the_triangle() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        assert_eq!(barycentric(Vec3::new(0.25, 0.5, 0.0), corners), [0.25, 0.25, 0.5]);
        assert_eq!(barycentric(Vec3::new(2.0, -0.5, 0.0), corners), [-0.5, 2.0, -0.5]);
        assert_eq!(clamped_barycentric(Vec3::new(2.0, -0.5, 0.0), corners), [0.0, 1.0, 0.0]);
        assert_eq!(barycentric(Vec3::ONE, [Vec3::X; 3]), [1.0 / 3.0; 3]);
    }
}
