//! Ray and closest-point queries on triangles.
//!
//! obvhs builds the hierarchy and traces rays; the closest-point query is an ordered traversal over its nodes. obvhs
//! brings its own glam: this is the only module that touches those types.

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;

/// Deepest hierarchy the closest-point stack holds. PLOC trees of a million triangles stay below 64.
const STACK: usize = 192;

/// A bounding volume hierarchy over triangles that it owns.
pub struct Bvh {
    tree: Bvh2,
    corners: Vec<[Vec3A; 3]>,
}

/// Where a query met the triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle.
    pub triangle: u32,
    /// Along the ray in units of its direction, or from the query point in metres.
    pub distance: f32,
    /// The point on the triangle.
    pub point: Vec3,
}

impl Bvh {
    /// Builds the hierarchy. All corners must be finite.
    pub fn new(positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let corners: Vec<[Vec3A; 3]> =
            triangles.iter().map(|t| t.map(|v| Vec3A::from(positions[v as usize]))).collect();
        let out: Vec<Triangle> =
            corners.iter().map(|t| Triangle { v0: outward(t[0]), v1: outward(t[1]), v2: outward(t[2]) }).collect();
        let tree = build_bvh2_from_tris(&out, BvhBuildParams::medium_build(), &mut Duration::default());
        Self { tree, corners }
    }

    /// Unit normal of a triangle; zero without area.
    pub fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners[triangle as usize];
        (b - a).cross(c - a).normalize_or_zero().into()
    }

    /// The triangle nearest to `point` within `max_distance`.
    pub fn closest(&self, point: Vec3, max_distance: f32) -> Option<Hit> {
        self.closest_where(point, max_distance, |_| true)
    }

    /// As [`Self::closest`], seeing only triangles for which `accept` holds.
    pub fn closest_where(&self, point: Vec3, max_distance: f32, accept: impl Fn(u32) -> bool) -> Option<Hit> {
        if self.corners.is_empty() {
            return None;
        }
        let p = Vec3A::from(point);
        let mut best = max_distance * max_distance;
        let mut found: Option<(u32, Vec3A)> = None;
        let mut stack = [(0u32, 0f32); STACK];
        stack[0] = (0, self.box_distance_squared(0, p));
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (index, distance) = stack[depth];
            if distance > best {
                continue;
            }
            let node = &self.tree.nodes[index as usize];
            if node.is_leaf() {
                for i in node.first_index..node.first_index + node.prim_count {
                    let triangle = self.tree.primitive_indices[i as usize];
                    if !accept(triangle) {
                        continue;
                    }
                    let q = closest_point(p, &self.corners[triangle as usize]);
                    let d = (q - p).length_squared();
                    // Equal distances go to the lower index: the answer does not depend on the tree.
                    if d < best || (d == best && found.is_none_or(|(t, _)| triangle < t)) {
                        best = d;
                        found = Some((triangle, q));
                    }
                }
                continue;
            }
            let children = [node.first_index, node.first_index + 1].map(|i| (i, self.box_distance_squared(i, p)));
            let (near, far) =
                if children[0].1 <= children[1].1 { (children[0], children[1]) } else { (children[1], children[0]) };
            if depth + 2 <= STACK {
                stack[depth] = far;
                stack[depth + 1] = near;
                depth += 2;
            }
        }
        found.map(|(triangle, q)| Hit { triangle, distance: best.sqrt(), point: q.into() })
    }

    /// The first triangle a ray meets, `distance` in units of `direction`, between 0 and `max_distance`.
    pub fn cast(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<Hit> {
        self.cast_where(origin, direction, max_distance, |_, _| true)
    }

    /// As [`Self::cast`], seeing only triangles for which `accept(triangle, point)` holds.
    pub fn cast_where(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        mut accept: impl FnMut(u32, Vec3) -> bool,
    ) -> Option<Hit> {
        if self.corners.is_empty() {
            return None;
        }
        let (o, d) = (Vec3A::from(origin), Vec3A::from(direction));
        let mut hit = RayHit::none();
        let ray = Ray::new(outward(o), outward(d), 0.0, max_distance);
        let met = self.tree.ray_traverse(ray, &mut hit, |ray, i| {
            let triangle = self.tree.primitive_indices[i];
            match intersect(o, d, &self.corners[triangle as usize]) {
                Some(t) if t > 0.0 && t < ray.tmax && accept(triangle, origin + direction * t) => t,
                _ => f32::INFINITY,
            }
        });
        met.then(|| Hit {
            triangle: self.tree.primitive_indices[hit.primitive_id as usize],
            distance: hit.t,
            point: origin + direction * hit.t,
        })
    }

    /// Whether a ray meets anything between 0 and `max_distance`.
    pub fn occluded(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> bool {
        self.occluded_where(origin, direction, max_distance, |_| true)
    }

    /// As [`Self::occluded`], by triangles for which `accept(triangle)` holds.
    pub fn occluded_where(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        accept: impl Fn(u32) -> bool,
    ) -> bool {
        if self.corners.is_empty() {
            return false;
        }
        let (o, d) = (Vec3A::from(origin), Vec3A::from(direction));
        let ray = Ray::new(outward(o), outward(d), 0.0, max_distance);
        !self.tree.ray_traverse_miss(ray, |_, i| {
            let triangle = self.tree.primitive_indices[i];
            let met = intersect(o, d, &self.corners[triangle as usize]).filter(|&t| t > 0.0 && accept(triangle));
            met.unwrap_or(f32::INFINITY)
        })
    }

    fn box_distance_squared(&self, node: u32, p: Vec3A) -> f32 {
        let aabb = self.tree.nodes[node as usize].aabb();
        let (low, high) = (inward(aabb.min), inward(aabb.max));
        (p.clamp(low, high) - p).length_squared()
    }
}

/// The point of a triangle nearest to `p` (Ericson 2005, 5.1.5). Degenerate triangles give a point of one of their edges.
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

/// Distance along a ray to a triangle (Möller and Trumbore 1997), from either side.
fn intersect(o: Vec3A, d: Vec3A, &[a, b, c]: &[Vec3A; 3]) -> Option<f32> {
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let det = e1.dot(p);
    if det == 0.0 {
        return None;
    }
    let inv = 1.0 / det;
    let s = o - a;
    let u = s.dot(p) * inv;
    let q = s.cross(e1);
    let v = d.dot(q) * inv;
    if !(u >= 0.0 && v >= 0.0 && u + v <= 1.0) {
        return None;
    }
    Some(e2.dot(q) * inv)
}

fn outward(v: Vec3A) -> obvhs_glam::Vec3A {
    obvhs_glam::Vec3A::new(v.x, v.y, v.z)
}

fn inward(v: obvhs_glam::Vec3A) -> Vec3A {
    Vec3A::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quad() -> Bvh {
        Bvh::new(&[Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y], &[[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn closest_point_lies_on_face_edge_and_corner() {
        let bvh = quad();
        let at = |p| bvh.closest(p, 10.0).map(|h| (h.point, h.distance));
        assert_eq!(at(Vec3::new(0.75, 0.25, 2.0)), Some((Vec3::new(0.75, 0.25, 0.0), 2.0)));
        assert_eq!(at(Vec3::new(3.0, 0.5, 0.0)), Some((Vec3::new(1.0, 0.5, 0.0), 2.0)));
        assert_eq!(at(Vec3::new(-3.0, -4.0, 0.0)), Some((Vec3::ZERO, 5.0)));
        assert_eq!(bvh.closest(Vec3::new(0.0, 0.0, 2.0), 1.0), None);
    }

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
    fn rays_hit_from_both_sides_and_stop_at_their_length() {
        let bvh = quad();
        let from = |z: f32, d: Vec3, max| bvh.cast(Vec3::new(0.75, 0.25, z), d, max).map(|h| (h.triangle, h.distance));
        assert_eq!(from(1.0, -Vec3::Z, 9.0), Some((0, 1.0)));
        assert_eq!(from(-1.0, Vec3::Z, 9.0), Some((0, 1.0)));
        assert_eq!(from(1.0, -Vec3::Z, 0.5), None);
        assert!(bvh.occluded(Vec3::new(0.25, 0.75, 1.0), -Vec3::Z, 9.0));
        assert!(!bvh.occluded(Vec3::new(0.25, 0.75, 1.0), Vec3::Z, 9.0));
    }

    #[test]
    fn refused_triangles_are_seen_through() {
        let bvh = Bvh::new(
            &[Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, Vec3::X + Vec3::Z, Vec3::Y + Vec3::Z],
            &[[0, 1, 2], [3, 4, 5]],
        );
        let hit = bvh.cast_where(Vec3::new(0.2, 0.2, 2.0), -Vec3::Z, 9.0, |t, _| t == 0);
        assert_eq!(hit.map(|h| h.triangle), Some(0));
        let hit = bvh.closest_where(Vec3::new(0.2, 0.2, 2.0), 9.0, |t| t == 0);
        assert_eq!(hit.map(|h| (h.triangle, h.distance)), Some((0, 2.0)));
        assert_eq!(bvh.closest_where(Vec3::new(0.2, 0.2, 2.0), 1.5, |t| t == 0), None);
    }

    #[test]
    fn an_empty_tree_answers_nothing() {
        let bvh = Bvh::new(&[], &[]);
        assert!(bvh.closest(Vec3::ZERO, 1.0).is_none() && bvh.cast(Vec3::ZERO, Vec3::X, 1.0).is_none());
    }
}
