//! The bounding box of least area.

use glam::DVec2;

/// A bounding box that need not be parallel to the axes.
pub(super) struct OrientedBox {
    /// Unit direction of one of its sides.
    pub axis: DVec2,
    pub area: f64,
}

/// The bounding box of least area; one of its sides lies on the convex hull (Freeman and Shapira 1975).
pub(super) fn smallest_box(points: &[DVec2]) -> OrientedBox {
    let hull = convex_hull(points);
    let mut best = OrientedBox { axis: DVec2::X, area: f64::INFINITY };
    for i in 0..hull.len() {
        let Some(axis) = (hull[(i + 1) % hull.len()] - hull[i]).try_normalize() else { continue };
        let turned = hull.iter().map(|p| DVec2::new(axis.dot(*p), axis.perp_dot(*p)));
        let (low, high) = turned.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let area = (high - low).element_product();
        if area < best.area {
            best = OrientedBox { axis, area };
        }
    }
    best
}

/// Counter-clockwise convex hull (Andrew's monotone chain).
fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut hull: Vec<DVec2> = Vec::new();
    let half = |hull: &mut Vec<DVec2>, points: &mut dyn Iterator<Item = DVec2>| {
        let base = hull.len();
        for p in points {
            while hull.len() >= base + 2
                && (hull[hull.len() - 1] - hull[hull.len() - 2]).perp_dot(p - hull[hull.len() - 1]) <= 0.0
            {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    };
    half(&mut hull, &mut sorted.iter().copied());
    half(&mut hull, &mut sorted.iter().rev().copied());
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_box_of_a_turned_rectangle_is_the_rectangle() {
        let (u, v) = (DVec2::new(0.6, 0.8), DVec2::new(-0.8, 0.6));
        let OrientedBox { axis, area } = smallest_box(&[DVec2::ZERO, 3.0 * u, 3.0 * u + v, v, 1.5 * u + 0.5 * v]);
        assert!((area - 3.0).abs() < 1e-12);
        assert!(axis.dot(u).abs() > 1.0 - 1e-12 || axis.dot(v).abs() > 1.0 - 1e-12, "{axis}");
    }
}
