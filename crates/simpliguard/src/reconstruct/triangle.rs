//! Distances of four points at once to a triangle.
//!
//! Each SIMD lane holds one point, so nothing is gathered: every number of the triangle is broadcast to all four lanes.
//! Only sums and products in single precision are used, which are the same on every machine.

use glam::{Vec3, Vec3A, Vec4};

/// Four points, stored by coordinate.
pub(super) struct Points {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

impl Points {
    /// The corners of a unit square parallel to the x and y axes, the lowest at `p`, x fastest.
    pub(super) fn square(p: Vec3) -> Self {
        Self {
            x: Vec4::splat(p.x) + Vec4::new(0.0, 1.0, 0.0, 1.0),
            y: Vec4::splat(p.y) + Vec4::new(0.0, 0.0, 1.0, 1.0),
            z: Vec4::splat(p.z),
        }
    }

    fn relative_to(&self, p: Vec3A) -> Self {
        Self { x: self.x - Vec4::splat(p.x), y: self.y - Vec4::splat(p.y), z: self.z - Vec4::splat(p.z) }
    }

    fn dot(&self, v: Vec3A) -> Vec4 {
        self.x * Vec4::splat(v.x) + self.y * Vec4::splat(v.y) + self.z * Vec4::splat(v.z)
    }
}

/// A triangle, prepared for queries.
pub(super) struct Facet {
    normal: Vec3A,
    sides: [Side; 3],
}

struct Side {
    start: Vec3A,
    /// From the start to the end.
    displacement: Vec3A,
    /// The displacement over its squared length: its dot product with a point relative to the start is 0 at the start
    /// and 1 at the end.
    along: Vec3A,
    /// The direction in the plane of the triangle towards its interior.
    inward: Vec3A,
}

impl Facet {
    pub(super) fn new(&[a, b, c]: &[Vec3A; 3]) -> Self {
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let side = |start: Vec3A, end: Vec3A| {
            let displacement = end - start;
            let along = displacement / displacement.length_squared().max(f32::MIN_POSITIVE);
            Side { start, displacement, along, inward: normal.cross(displacement) }
        };
        Self { normal, sides: [side(a, b), side(b, c), side(c, a)] }
    }

    /// Squared distances to the points.
    pub(super) fn distances_squared(&self, points: &Points) -> Vec4 {
        let mut edge = Vec4::MAX;
        let mut inside = Vec4::MAX;
        for side in &self.sides {
            let p = points.relative_to(side.start);
            let t = p.dot(side.along).clamp(Vec4::ZERO, Vec4::ONE);
            let (x, y, z) = (
                p.x - t * Vec4::splat(side.displacement.x),
                p.y - t * Vec4::splat(side.displacement.y),
                p.z - t * Vec4::splat(side.displacement.z),
            );
            edge = edge.min(x * x + y * y + z * z);
            inside = inside.min(p.dot(side.inward));
        }
        // A triangle without area has no interior, so its sides give the distance.
        let height = points.relative_to(self.sides[0].start).dot(self.normal);
        Vec4::select(inside.cmpgt(Vec4::ZERO), height * height, edge)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::closest_point;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3A> {
        (-8i8..9, -8i8..9, -8i8..9).prop_map(|(x, y, z)| Vec3A::new(x.into(), y.into(), z.into()) * 0.5)
    }

    proptest! {
        /// On a coarse lattice, so that needles, points and places straight above edges and corners are common.
        #[test]
        fn distances_are_those_to_the_closest_point(a in point(), b in point(), c in point(), p in point()) {
            let found = Facet::new(&[a, b, c]).distances_squared(&Points::square(p.into())).to_array();
            for (i, found) in found.into_iter().enumerate() {
                let q = p + Vec3A::new((i & 1) as f32, (i >> 1) as f32, 0.0);
                let expected = closest_point(q, &[a, b, c]).distance(q);
                prop_assert!((found.sqrt() - expected).abs() < 2e-3, "{} {expected}", found.sqrt());
            }
        }
    }
}
