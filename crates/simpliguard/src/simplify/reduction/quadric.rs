//! Errors of attributes as a quadric: Hoppe 1999, with the values of a vertex as unknowns of their own.

use glam::{DMat3, DVec3};

use super::attributes::{COUNT, Values};

/// Sum of weighted squared differences of attributes from the linear functions that faces extend over space.
///
/// With the functions `g_i . p + d_i` of each face, the error of the values `s` at `p` is
/// `sum w sum_i (g_i . p + d_i - s_i)^2`.
#[derive(Clone)]
pub(super) struct AttributeQuadric {
    /// `sum w g g^T`, upper triangle: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    /// `sum w d g`.
    b: DVec3,
    /// `sum w d^2`.
    c: f64,
    /// `sum w g_i`.
    gradients: [DVec3; COUNT],
    /// `sum w d_i`.
    offsets: [f64; COUNT],
    weight: f64,
}

impl Default for AttributeQuadric {
    fn default() -> Self {
        let gradients = [DVec3::ZERO; COUNT];
        Self { a: [0.0; 6], b: DVec3::ZERO, c: 0.0, gradients, offsets: [0.0; COUNT], weight: 0.0 }
    }
}

impl AttributeQuadric {
    /// The errors of a face with these corners, unit normal and values at its corners. Without area it has none.
    pub(super) fn face(p: [DVec3; 3], n: DVec3, values: [&Values; 3], weight: f64) -> Self {
        let inverse = DMat3::from_cols(p[1] - p[0], p[2] - p[0], n).transpose().inverse();
        let mut out = Self::default();
        if !inverse.is_finite() {
            return out;
        }
        for i in 0..COUNT {
            let [s0, s1, s2] = values.map(|values| f64::from(values[i]));
            let g = inverse * DVec3::new(s1 - s0, s2 - s0, 0.0);
            let (d, w) = (s0 - g.dot(p[0]), weight * g);
            let products = [w.x * g.x, w.x * g.y, w.x * g.z, w.y * g.y, w.y * g.z, w.z * g.z];
            out.a.iter_mut().zip(products).for_each(|(a, product)| *a += product);
            out.b += w * d;
            out.c += weight * d * d;
            (out.gradients[i], out.offsets[i]) = (w, weight * d);
        }
        out.weight = weight;
        out
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.a.iter_mut().zip(other.a).for_each(|(a, b)| *a += b);
        self.b += other.b;
        self.c += other.c;
        self.gradients.iter_mut().zip(other.gradients).for_each(|(a, b)| *a += b);
        self.offsets.iter_mut().zip(other.offsets).for_each(|(a, b)| *a += b);
        self.weight += other.weight;
    }

    /// The error of values at `p`, never negative.
    pub(super) fn error(&self, p: DVec3, values: &Values) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let ap =
            DVec3::new(xx * p.x + xy * p.y + xz * p.z, xy * p.x + yy * p.y + yz * p.z, xz * p.x + yz * p.y + zz * p.z);
        let of_faces = p.dot(ap) + 2.0 * self.b.dot(p) + self.c;
        let of_values = (0..COUNT).map(|i| {
            let s = f64::from(values[i]);
            s * (self.weight * s - 2.0 * (self.gradients[i].dot(p) + self.offsets[i]))
        });
        (of_faces + of_values.sum::<f64>()).max(0.0)
    }

    /// The values of the least error at `p`; `None` if there is no face.
    pub(super) fn best(&self, p: DVec3) -> Option<Values> {
        let value = |i: usize| ((self.gradients[i].dot(p) + self.offsets[i]) / self.weight) as f32;
        (self.weight > 0.0).then(|| std::array::from_fn(value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    fn values(first: f32, last: f32) -> Values {
        let mut values = [0.0; COUNT];
        (values[0], values[COUNT - 1]) = (first, last);
        values
    }

    #[test]
    fn a_face_extends_its_values_over_its_plane() {
        let at_corners = [values(1.0, 0.0), values(3.0, 0.0), values(1.0, -2.0)];
        let quadric = AttributeQuadric::face(CORNERS, DVec3::Z, at_corners.each_ref(), 2.0);
        for p in [DVec3::ZERO, DVec3::new(0.5, -1.0, 4.0)] {
            let here = values(1.0 + 2.0 * p.x as f32, -2.0 * p.y as f32);
            assert_eq!(quadric.best(p), Some(here));
            assert!(quadric.error(p, &here) < 1e-9);
        }
        assert!((quadric.error(DVec3::ZERO, &values(1.5, 1.0)) - 2.0 * 1.25).abs() < 1e-9);
    }

    #[test]
    fn two_faces_that_disagree_meet_in_the_middle() {
        let constant = |s: f32, weight| AttributeQuadric::face(CORNERS, DVec3::Z, [&values(s, 0.0); 3], weight);
        let mut both = constant(1.0, 1.0);
        both.add(&constant(4.0, 2.0));
        assert_eq!(both.best(DVec3::X), Some(values(3.0, 0.0)));
        assert!((both.error(DVec3::X, &values(3.0, 0.0)) - 6.0).abs() < 1e-9);
    }

    #[test]
    fn a_face_without_area_has_no_error() {
        let quadric = AttributeQuadric::face([DVec3::ZERO; 3], DVec3::ZERO, [&values(1.0, 2.0); 3], 1.0);
        assert!(quadric.best(DVec3::X).is_none() && quadric.error(DVec3::X, &values(9.0, 9.0)) == 0.0);
    }
}
