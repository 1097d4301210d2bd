//! Distances of segments.

use glam::Vec3;

/// Distance between two segments, which may be points (Ericson 2005, section 5.1.9).
pub(super) fn segment_distance([p1, q1]: [Vec3; 2], [p2, q2]: [Vec3; 2]) -> f32 {
    let (d1, d2, r) = (q1 - p1, q2 - p2, p1 - p2);
    let (a, e, b) = (d1.length_squared(), d2.length_squared(), d1.dot(d2));
    let (c, f) = (d1.dot(r), d2.dot(r));
    let (a, e) = (a.max(f32::MIN_POSITIVE), e.max(f32::MIN_POSITIVE));
    let denominator = a * e - b * b;
    let s = if denominator > 0.0 { ((b * f - c * e) / denominator).clamp(0.0, 1.0) } else { 0.0 };
    let t = (b * s + f) / e;
    let (s, t) = if t < 0.0 {
        ((-c / a).clamp(0.0, 1.0), 0.0)
    } else if t > 1.0 {
        (((b - c) / a).clamp(0.0, 1.0), 1.0)
    } else {
        (s, t)
    };
    (p1 + d1 * s).distance(p2 + d2 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_segments() {
        let x = [Vec3::ZERO, Vec3::X];
        let cases = [
            ([Vec3::new(0.5, -1.0, 2.0), Vec3::new(0.5, 1.0, 2.0)], 2.0),
            ([Vec3::new(0.0, 3.0, 0.0), Vec3::new(1.0, 3.0, 0.0)], 3.0),
            ([Vec3::new(2.0, 0.0, 0.0), Vec3::new(5.0, 0.0, 0.0)], 1.0),
            ([Vec3::new(1.0, 1.0, 0.0), Vec3::new(4.0, 4.0, 0.0)], 1.0),
        ];
        for (other, distance) in cases {
            assert!((segment_distance(x, other) - distance).abs() < 1e-6, "{other:?}");
            assert!((segment_distance(other, x) - distance).abs() < 1e-6, "{other:?}");
        }
    }
}
