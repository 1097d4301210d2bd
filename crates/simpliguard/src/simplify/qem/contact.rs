//! Contacts of two intersecting faces: the shortest displacement that separates them.

use glam::DVec3;

use crate::geometry::area_vector;

/// The contact of two intersecting faces, which is resolved along the normal of one of them.
#[derive(Debug)]
pub(super) struct Contact {
    /// Unit direction.
    pub(super) direction: DVec3,
    /// Depth to which the faces reach into each other.
    pub(super) depth: f64,
    /// Weights of the corners of the first and of the second face: the depth by which the contact gets shallower when
    /// the corner moves by one along `direction`.
    pub(super) weights: [f64; 6],
}

impl Contact {
    /// The shallower of the contacts along both normals; `None` if the faces do not intersect.
    pub(super) fn between(a: &[DVec3; 3], b: &[DVec3; 3]) -> Option<Self> {
        let over_a = Self::over(a, b);
        let over_b = Self::over(b, a).map(|mut contact| {
            contact.weights.rotate_left(3);
            contact
        });
        match (over_a, over_b) {
            (Some(a), Some(b)) => Some(if b.depth < a.depth { b } else { a }),
            (a, b) => a.or(b),
        }
    }

    /// The contact along the normal of `floor`. Only the part of `face` above or below `floor` counts; it is moved to
    /// one side.
    fn over(floor: &[DVec3; 3], face: &[DVec3; 3]) -> Option<Self> {
        let normal = area_vector(floor).try_normalize()?;
        let at = |w: DVec3| face[0] * w.x + face[1] * w.y + face[2] * w.z;
        // The corners of that part, in barycentric coordinates of `face`.
        let mut polygon = vec![DVec3::X, DVec3::Y, DVec3::Z];
        for k in 0..3 {
            let inward = normal.cross(floor[(k + 1) % 3] - floor[k]);
            polygon = clipped(&polygon, |w| (at(w) - floor[k]).dot(inward));
        }
        let heights = polygon.iter().map(|&w| ((at(w) - floor[0]).dot(normal), w));
        let highest = heights.clone().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let lowest = heights.min_by(|a, b| a.0.total_cmp(&b.0))?;
        if highest.0 <= 0.0 || lowest.0 >= 0.0 {
            return None;
        }
        let upwards = -lowest.0 <= highest.0;
        let (depth, of_face) = if upwards { (-lowest.0, lowest.1) } else { (highest.0, highest.1) };
        let of_floor = -barycentric(floor, at(of_face));
        let weights = [of_floor.x, of_floor.y, of_floor.z, of_face.x, of_face.y, of_face.z];
        Some(Self { direction: if upwards { normal } else { -normal }, depth, weights })
    }
}

/// The part of a convex polygon where a linear function is not negative (Sutherland and Hodgman 1974).
fn clipped(polygon: &[DVec3], height: impl Fn(DVec3) -> f64) -> Vec<DVec3> {
    let mut out = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (hp, hq) = (height(p), height(q));
        if hp >= 0.0 {
            out.push(p);
        }
        if hp * hq < 0.0 {
            out.push(p.lerp(q, hp / (hp - hq)));
        }
    }
    out
}

/// Barycentric coordinates of the projection of `p` on a triangle that has an area.
fn barycentric(corners: &[DVec3; 3], p: DVec3) -> DVec3 {
    let [a, b, c] = *corners;
    let normal = area_vector(corners);
    let (v, w) = ((p - a).cross(c - a).dot(normal), (b - a).cross(p - a).dot(normal));
    let (v, w) = (v / normal.length_squared(), w / normal.length_squared());
    DVec3::new(1.0 - v - w, v, w)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOR: [DVec3; 3] = [DVec3::new(-9.0, -9.0, 0.0), DVec3::new(9.0, -9.0, 0.0), DVec3::new(0.0, 9.0, 0.0)];

    #[test]
    fn a_corner_under_the_floor_is_lifted_by_its_depth() {
        let face = [DVec3::new(0.0, 0.0, -0.1), DVec3::new(1.0, 0.0, 0.5), DVec3::new(0.0, 1.0, 0.5)];
        let contact = Contact::between(&FLOOR, &face).expect("they intersect");
        assert!(contact.direction.abs_diff_eq(DVec3::Z, 1e-12) && (contact.depth - 0.1).abs() < 1e-12);
        let expected = [-0.25, -0.25, -0.5, 1.0, 0.0, 0.0];
        assert!(contact.weights.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{contact:?}");
        let other = Contact::between(&face, &FLOOR).expect("they intersect");
        assert!((other.depth - contact.depth).abs() < 1e-12 && other.weights[..3] == contact.weights[3..]);
    }

    #[test]
    fn what_lies_beside_the_floor_does_not_count() {
        // A tenth below the floor at one end of it, half as much above at the other, and far above behind that.
        let face = [DVec3::new(-1.0, 0.0, -0.1), DVec3::new(-1.0, 0.5, -0.1), DVec3::new(40.0, 0.0, 1.018)];
        let contact = Contact::over(&FLOOR, &face).expect("they intersect");
        assert!(contact.direction.abs_diff_eq(-DVec3::Z, 1e-12) && (contact.depth - 0.05).abs() < 0.005, "{contact:?}");
        assert!(Contact::between(&FLOOR, &face.map(|p| p + DVec3::Z * 0.2)).is_none());
    }
}
