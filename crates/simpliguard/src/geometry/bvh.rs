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

use super::triangle::{closest_point, ray_distance};

/// Depth of the stack of the closest-point query. PLOC trees of a million triangles stay below 64.
const STACK: usize = 192;

/// A bounding volume hierarchy over its own copy of the triangles.
pub struct Bvh {
    tree: Bvh2,
    corners: Vec<[Vec3A; 3]>,
}

/// The point at which a query meets the triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle.
    pub triangle: u32,
    /// Distance along the ray in units of its direction, or from the query point in metres.
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

    /// As [`Self::closest`], among the triangles that `accept` admits.
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
                    // Of equal distances the lower index wins, so the answer does not depend on the tree.
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

    /// The first triangle that a ray meets between 0 and `max_distance`, in units of `direction`.
    pub fn cast(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<Hit> {
        self.cast_where(origin, direction, max_distance, |_, _| true)
    }

    /// As [`Self::cast`], among the triangles that `accept(triangle, point)` admits.
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
            match ray_distance(o, d, &self.corners[triangle as usize]) {
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

    /// True if a ray meets a triangle between 0 and `max_distance`, in units of `direction`.
    pub fn occluded(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> bool {
        self.occluder_where(origin, direction, max_distance, |_| true).is_some()
    }

    /// A triangle that a ray meets between 0 and `max_distance`, among those that `accept` admits. Not always the first.
    pub fn occluder_where(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        accept: impl Fn(u32) -> bool,
    ) -> Option<u32> {
        if self.corners.is_empty() {
            return None;
        }
        let ray = Ray::new(outward(origin.into()), outward(direction.into()), 0.0, max_distance);
        let mut occluder = None;
        self.tree.ray_traverse_miss(ray, |_, i| {
            let triangle = self.tree.primitive_indices[i];
            if !self.is_occluder(triangle, origin, direction, max_distance) || !accept(triangle) {
                return f32::INFINITY;
            }
            occluder = Some(triangle);
            0.0
        });
        occluder
    }

    /// True if a ray meets `triangle` between 0 and `max_distance`, in units of `direction`.
    #[inline]
    pub fn is_occluder(&self, triangle: u32, origin: Vec3, direction: Vec3, max_distance: f32) -> bool {
        let corners = &self.corners[triangle as usize];
        ray_distance(origin.into(), direction.into(), corners).is_some_and(|t| t > 0.0 && t < max_distance)
    }

    fn box_distance_squared(&self, node: u32, p: Vec3A) -> f32 {
        let aabb = self.tree.nodes[node as usize].aabb();
        let (low, high) = (inward(aabb.min), inward(aabb.max));
        (p.clamp(low, high) - p).length_squared()
    }
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
