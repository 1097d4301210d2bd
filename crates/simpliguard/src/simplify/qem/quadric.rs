//! Quadric error metric with a curvature attribute.
//!
//! The distance to planes follows Garland and Heckbert 1997. The curvature constraint takes the attribute form of Hoppe
//! 1999: over each face the curvature is the linear function `g . p + q`, and a vertex with curvature `c` has the error
//! `(g . p + q - c)^2`. The best `c` for a position is eliminated: `sum w (g . p + q)^2 - (G . p + Q)^2 / W`.

use glam::{DMat3, DVec3, DVec4};

/// Sum of squared distances to weighted planes, and of weighted curvature errors.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Quadric {
    pub(super) planes: Planes,
    pub(super) attribute: Attribute,
}

/// Sum of weighted squared distances to planes: `p A p + 2 b p + c`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Planes {
    /// Upper triangle of the 3 x 3 matrix: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: DVec3,
    c: f64,
}

/// Sums of the curvature attribute.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Attribute {
    /// `G` and `Q`.
    gradient: DVec4,
    /// `W`.
    weight: f64,
}

impl Planes {
    pub(super) fn add(&mut self, other: &Self) {
        for (a, b) in self.a.iter_mut().zip(&other.a) {
            *a += b;
        }
        self.b += other.b;
        self.c += other.c;
    }

    fn at(&self, p: DVec3) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let ap =
            DVec3::new(xx * p.x + xy * p.y + xz * p.z, xy * p.x + yy * p.y + yz * p.z, xz * p.x + yz * p.y + zz * p.z);
        p.dot(ap) + 2.0 * self.b.dot(p) + self.c
    }
}

impl Attribute {
    pub(super) fn add(&mut self, other: &Self) {
        self.gradient += other.gradient;
        self.weight += other.weight;
    }
}

impl Quadric {
    /// Squared distance to the plane `n . p + d = 0`, times `weight`.
    pub(crate) fn plane(n: DVec3, d: f64, weight: f64) -> Self {
        let w = n * weight;
        let a = [w.x * n.x, w.x * n.y, w.x * n.z, w.y * n.y, w.y * n.z, w.z * n.z];
        Self { planes: Planes { a, b: w * d, c: weight * d * d }, ..Self::default() }
    }

    /// Curvature errors of a face with corners `p`, normal `n` and curvatures `c` at its corners, times `weight`.
    pub(super) fn curvature(p: [DVec3; 3], n: DVec3, c: [f64; 3], weight: f64) -> Self {
        // Solves [p 1; n 0] (g, q) = (c, 0): g lies in the plane of the face.
        let m = DMat3::from_cols(p[1] - p[0], p[2] - p[0], n).transpose();
        let g = m.inverse() * DVec3::new(c[1] - c[0], c[2] - c[0], 0.0);
        if !g.is_finite() {
            return Self::default();
        }
        let q = c[0] - g.dot(p[0]);
        Self { attribute: Attribute { gradient: g.extend(q) * weight, weight }, ..Self::plane(g, q, weight) }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.planes.add(&other.planes);
        self.attribute.add(&other.attribute);
    }

    /// The error at `p`, never negative.
    pub(crate) fn error(&self, p: DVec3) -> f64 {
        let Attribute { gradient, weight } = self.attribute;
        let mean = gradient.dot(p.extend(1.0));
        let attribute = if weight > 0.0 { mean * mean / weight } else { 0.0 };
        (self.planes.at(p) - attribute).max(0.0)
    }

    /// The position of the least error; `None` if that is ill defined.
    pub(crate) fn minimum(&self) -> Option<DVec3> {
        let Planes { a: [mut xx, mut xy, mut xz, mut yy, mut yz, mut zz], mut b, .. } = self.planes;
        let Attribute { gradient, weight } = self.attribute;
        if weight > 0.0 {
            let g = gradient.truncate();
            let w = g / weight;
            (xx, xy, xz) = (xx - w.x * g.x, xy - w.x * g.y, xz - w.x * g.z);
            (yy, yz, zz) = (yy - w.y * g.y, yz - w.y * g.z, zz - w.z * g.z);
            b -= w * gradient.w;
        }
        // The adjugate of a symmetric matrix is symmetric.
        let x = DVec3::new(yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let determinant = xx * x.x + xy * x.y + xz * x.z;
        let scale = (xx + yy + zz) / 3.0;
        if determinant.abs() <= 1e-5 * scale * scale * scale {
            return None;
        }
        let y = DVec3::new(x.y, xx * zz - xz * xz, xy * xz - xx * yz);
        let z = DVec3::new(x.z, y.z, xx * yy - xy * xy);
        Some(DVec3::new(x.dot(b), y.dot(b), z.dot(b)) / -determinant)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_at_their_minimum() {
        let mut q = Quadric::plane(DVec3::X, -1.0, 2.0);
        q.add(&Quadric::plane(DVec3::Y, -2.0, 1.0));
        q.add(&Quadric::plane(DVec3::Z, -3.0, 1.0));
        assert!((q.minimum().expect("regular") - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        assert_eq!(q.error(DVec3::new(2.0, 2.0, 3.0)), 2.0);
    }

    #[test]
    fn one_plane_has_no_single_minimum() {
        assert!(Quadric::plane(DVec3::X, -1.0, 1.0).minimum().is_none());
    }

    #[test]
    fn a_face_has_no_curvature_error_on_itself_and_two_faces_disagree() {
        let p = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let one = Quadric::curvature(p, DVec3::Z, [0.0, 1.0, 0.0], 1.0);
        assert!(one.error(DVec3::new(0.3, 0.4, 5.0)) < 1e-12);
        let mut two = one;
        two.add(&Quadric::curvature(p, DVec3::Z, [0.0, 0.0, 0.0], 1.0));
        // Values 1 and 0 at x = 1: mean one half, each a half off.
        assert!((two.error(DVec3::X) - 0.5).abs() < 1e-12);
    }
}
