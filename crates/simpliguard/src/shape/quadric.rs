//! Quadric error metric with a curvature attribute.
//!
//! Garland and Heckbert 1997 for the distance to planes; for the curvature constraint the attribute form of Hoppe 1999:
//! over each face the curvature is the linear function `g . p + q`, and a vertex with curvature `c` errs by
//! `(g . p + q - c)^2`. The best `c` for a position is eliminated: `sum w (g . p + q)^2 - (G . p + Q)^2 / W`.

use glam::{DMat3, DVec3, DVec4};

/// Sum of squared distances to weighted planes, and of weighted curvature errors.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Quadric {
    /// Upper triangle of the 3 x 3 matrix: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: DVec3,
    c: f64,
    /// `G`, `Q` and `W` of the curvature attribute.
    gradient: DVec4,
    weight: f64,
}

impl Quadric {
    /// Squared distance to the plane `n . p + d = 0`, times `weight`.
    pub(super) fn plane(n: DVec3, d: f64, weight: f64) -> Self {
        let w = n * weight;
        Self {
            a: [w.x * n.x, w.x * n.y, w.x * n.z, w.y * n.y, w.y * n.z, w.z * n.z],
            b: w * d,
            c: weight * d * d,
            ..Self::default()
        }
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
        Self { gradient: g.extend(q) * weight, weight, ..Self::plane(g, q, weight) }
    }

    pub(super) fn add(&mut self, other: &Self) {
        for (a, b) in self.a.iter_mut().zip(&other.a) {
            *a += b;
        }
        self.b += other.b;
        self.c += other.c;
        self.gradient += other.gradient;
        self.weight += other.weight;
    }

    /// The error at `p`, never negative.
    pub(super) fn error(&self, p: DVec3) -> f64 {
        let planes = p.dot(self.times(p)) + 2.0 * self.b.dot(p) + self.c;
        let attribute = if self.weight > 0.0 {
            let mean = self.gradient.dot(p.extend(1.0));
            mean * mean / self.weight
        } else {
            0.0
        };
        (planes - attribute).max(0.0)
    }

    /// Where the error is least, unless that is ill defined.
    pub(super) fn minimum(&self) -> Option<DVec3> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let mut m = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
        let mut b = self.b;
        if self.weight > 0.0 {
            let g = self.gradient.truncate();
            m -= DMat3::from_cols(g * g.x, g * g.y, g * g.z) * (1.0 / self.weight);
            b -= g * (self.gradient.w / self.weight);
        }
        let scale = (m.x_axis.x + m.y_axis.y + m.z_axis.z) / 3.0;
        let determinant = m.determinant();
        (determinant.abs() > 1e-5 * scale * scale * scale).then(|| -(m.inverse() * b))
    }

    fn times(&self, p: DVec3) -> DVec3 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        DVec3::new(xx * p.x + xy * p.y + xz * p.z, xy * p.x + yy * p.y + yz * p.z, xz * p.x + yz * p.y + zz * p.z)
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
