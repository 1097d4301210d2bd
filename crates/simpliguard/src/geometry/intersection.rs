//! Self-intersections of a mesh.

use glam::{DVec2, DVec3, Vec3Swizzles as _};
use rayon::prelude::*;

use super::face_tree::{Box3, FaceTree};
use super::triangle::{area_vector, doubled_area};
use crate::data::TriMesh;

/// Distance from a plane, as a fraction of a triangle's extent, below which a corner lies in the plane.
const FLAT: f64 = 1e-9;

/// Pairs of triangles that intersect each other, the lower index first, in rising order. Triangles that share an edge
/// do not count. Triangles that share a corner count if they meet elsewhere too. Corners with equal positions are
/// shared.
pub(crate) fn intersecting_pairs(mesh: &TriMesh) -> Vec<(u32, u32)> {
    let corners: Vec<[DVec3; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t).map(|p| p.as_dvec3())).collect();
    let tree = FaceTree::new(corners.len(), (0..).zip(corners.iter().copied()));
    (0..corners.len() as u32)
        .into_par_iter()
        .with_min_len(256)
        .flat_map_iter(|t| {
            let own = &corners[t as usize];
            let mut pairs = Vec::new();
            tree.any(&Box3::around(own), |other| {
                if other > t && intersect(own, &corners[other as usize]) {
                    pairs.push((t, other));
                }
                false
            });
            pairs.sort_unstable();
            pairs
        })
        .collect()
}

/// Flags of the triangles that intersect another one. Triangles that share an edge do not count. Triangles that share a
/// corner count if they meet elsewhere too. Corners with equal positions are shared.
pub fn self_intersecting(mesh: &TriMesh) -> Vec<bool> {
    let mut found = vec![false; mesh.triangles.len()];
    for (a, b) in intersecting_pairs(mesh) {
        found[a as usize] = true;
        found[b as usize] = true;
    }
    found
}

/// True if two triangles intersect each other, in the sense of [`intersecting_pairs`].
pub(crate) fn intersect(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let mut shared = [(0, 0); 3];
    let mut count = 0;
    for (i, p) in a.iter().enumerate() {
        if let Some(j) = b.iter().position(|q| p == q) {
            shared[count] = (i, j);
            count += 1;
        }
    }
    match count {
        0 => separate_triangles_meet(a, b),
        1 => {
            let (i, j) = shared[0];
            // They meet along a ray from the shared corner. Where the shorter of both pieces of that ray ends, the edge
            // opposite the corner crosses the other triangle.
            crosses([a[(i + 1) % 3], a[(i + 2) % 3]], b) || crosses([b[(j + 1) % 3], b[(j + 2) % 3]], a)
        }
        _ => false,
    }
}

/// The test for triangles without a common corner: intervals on the line in which their planes meet (Möller 1997).
fn separate_triangles_meet(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let (na, nb) = (area_vector(a), area_vector(b));
    let (db, da) = (heights(b, a[0], na), heights(a, b[0], nb));
    if one_sided(db) || one_sided(da) {
        return false;
    }
    let line = na.cross(nb);
    if da == [0.0; 3]
        || db == [0.0; 3]
        || line.length_squared() <= FLAT * FLAT * na.length_squared() * nb.length_squared()
    {
        return coplanar_triangles_meet(a, b, na);
    }
    let axis = line.normalize_or_zero();
    match (interval(a, da, axis), interval(b, db, axis)) {
        (Some((a0, a1)), Some((b0, b1))) => a0 <= b1 && b0 <= a1,
        _ => false,
    }
}

/// The interval along `axis` in which a triangle meets a plane, given the heights `d` of its corners over that plane.
fn interval(corners: &[DVec3; 3], d: [f64; 3], axis: DVec3) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for k in 0..3 {
        let (p, q, dp, dq) = (corners[k], corners[(k + 1) % 3], d[k], d[(k + 1) % 3]);
        let at = if dp == 0.0 {
            p
        } else if dp * dq < 0.0 {
            p + (q - p) * (dp / (dp - dq))
        } else {
            continue;
        };
        let along = (at - corners[0]).dot(axis) + corners[0].dot(axis);
        (low, high) = (low.min(along), high.max(along));
    }
    (low <= high).then_some((low, high))
}

/// Heights of corners over a plane, times the length of its normal; zero where only rounding differs from zero.
fn heights(corners: &[DVec3; 3], origin: DVec3, normal: DVec3) -> [f64; 3] {
    let reach = corners.iter().map(|p| (*p - origin).length_squared()).fold(0.0, f64::max).sqrt();
    let flat = FLAT * reach * normal.length();
    corners.map(|p| (p - origin).dot(normal)).map(|d| if d.abs() <= flat { 0.0 } else { d })
}

fn one_sided(d: [f64; 3]) -> bool {
    d.iter().all(|d| *d > 0.0) || d.iter().all(|d| *d < 0.0)
}

/// True if a segment crosses the interior of a triangle.
fn crosses([p, q]: [DVec3; 2], triangle: &[DVec3; 3]) -> bool {
    let n = area_vector(triangle);
    let (dp, dq) = ((p - triangle[0]).dot(n), (q - triangle[0]).dot(n));
    let flat = FLAT * n.length() * (p - triangle[0]).length().max((q - triangle[0]).length());
    if dp * dq >= 0.0 || dp.abs() <= flat || dq.abs() <= flat {
        return false;
    }
    let at = p + (q - p) * (dp / (dp - dq));
    let inside = |k: usize| (triangle[(k + 1) % 3] - triangle[k]).cross(at - triangle[k]).dot(n);
    let least = FLAT * n.length_squared();
    (0..3).all(|k| inside(k) > least)
}

/// The test for triangles in one plane: an edge of one crosses an edge of the other, or one holds a corner of the
/// other.
fn coplanar_triangles_meet(a: &[DVec3; 3], b: &[DVec3; 3], n: DVec3) -> bool {
    let n = n.abs();
    let flat = |p: DVec3| match (n.x >= n.y && n.x >= n.z, n.y >= n.z) {
        (true, _) => p.yz(),
        (_, true) => DVec2::new(p.z, p.x),
        _ => p.xy(),
    };
    let (a, b) = (a.map(flat), b.map(flat));
    let side = |p: DVec2, q: DVec2, r: DVec2| doubled_area(&[p, q, r]);
    let cross = |i: usize, j: usize| {
        let ([p, q], [r, s]) = ([a[i], a[(i + 1) % 3]], [b[j], b[(j + 1) % 3]]);
        side(p, q, r) * side(p, q, s) < 0.0 && side(r, s, p) * side(r, s, q) < 0.0
    };
    let holds = |t: &[DVec2; 3], p: DVec2| {
        let s = [0, 1, 2].map(|k| side(t[k], t[(k + 1) % 3], p));
        s.iter().all(|s| *s > 0.0) || s.iter().all(|s| *s < 0.0)
    };
    (0..9).any(|i| cross(i / 3, i % 3)) || holds(&a, b[0]) || holds(&b, a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(p: [[f64; 3]; 3]) -> [DVec3; 3] {
        p.map(DVec3::from)
    }

    fn both(a: [[f64; 3]; 3], b: [[f64; 3]; 3]) -> bool {
        let (a, b) = (triangle(a), triangle(b));
        let met = intersect(&a, &b);
        assert_eq!(met, intersect(&b, &a), "symmetric");
        met
    }

    const FLOOR: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

    #[test]
    fn a_spike_through_a_floor_meets_it_and_one_above_does_not() {
        assert!(both(FLOOR, [[1.0, 1.0, -1.0], [1.0, 1.2, 1.0], [1.2, 1.0, 1.0]]));
        assert!(!both(FLOOR, [[1.0, 1.0, 0.1], [1.0, 1.2, 1.0], [1.2, 1.0, 1.0]]));
        assert!(!both(FLOOR, [[5.0, 5.0, -1.0], [5.0, 5.2, 1.0], [5.2, 5.0, 1.0]]));
    }

    #[test]
    fn triangles_of_one_edge_never_count() {
        assert!(!both(FLOOR, [FLOOR[0], FLOOR[1], [1.0, 1.0, 0.0]]));
    }

    #[test]
    fn triangles_of_one_corner_count_where_they_meet_beside_it() {
        assert!(!both(FLOOR, [FLOOR[0], [-1.0, -1.0, 1.0], [-1.0, 0.0, 1.0]]));
        assert!(both(FLOOR, [FLOOR[0], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]), "the small one's far edge");
        assert!(both(FLOOR, [FLOOR[0], [9.0, 9.0, 1.0], [9.0, 9.0, -1.0]]), "the floor's far edge");
    }

    #[test]
    fn triangles_of_one_plane_meet_where_they_overlap() {
        assert!(both(FLOOR, [[1.0, 1.0, 0.0], [9.0, 1.0, 0.0], [1.0, 9.0, 0.0]]));
        assert!(both(FLOOR, [[0.5, 0.5, 0.0], [1.0, 0.5, 0.0], [0.5, 1.0, 0.0]]), "held");
        assert!(!both(FLOOR, [[3.0, 3.0, 0.0], [9.0, 3.0, 0.0], [3.0, 9.0, 0.0]]));
    }

    #[test]
    fn two_crossing_tetrahedra_are_found_and_two_apart_are_not() {
        let one = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| p.as_vec3());
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let pair = |offset: f32| TriMesh {
            positions: one.iter().copied().chain(one.iter().map(|p| *p + offset)).collect(),
            triangles: faces.iter().copied().chain(faces.map(|f| f.map(|v| v + 4))).collect(),
        };
        assert_eq!(self_intersecting(&pair(2.0)), [false; 8]);
        // The far face of the first cuts the three near faces of the second.
        assert_eq!(self_intersecting(&pair(0.2)), [false, false, false, true, true, true, true, false]);
    }
}
