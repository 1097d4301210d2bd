//! The nearest of many points.

use std::ops::Range;

use glam::Vec3;

/// Points per leaf.
const LEAF: usize = 8;

/// A balanced k-d tree: a permutation of the points. Each range of it is split at its middle, along the axis of its
/// largest extent.
pub(crate) struct KdTree<'a> {
    points: &'a [Vec3],
    order: Vec<u32>,
    /// Axis and coordinate of the plane that splits each range, stored at the range's middle.
    planes: Vec<(u8, f32)>,
}

impl<'a> KdTree<'a> {
    /// The tree over `points`.
    pub(crate) fn new(points: &'a [Vec3]) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut planes = vec![(0, 0.0); points.len()];
        split(points, &mut order, &mut planes);
        Self { points, order, planes }
    }

    /// Distance in metres and index of the `k` points nearest to `at`, or of all if there are fewer; nearest first, of
    /// equally distant points the lower index first.
    pub(crate) fn nearest(&self, at: Vec3, k: usize) -> Vec<(f32, u32)> {
        let mut best = Vec::with_capacity(k.min(self.points.len()) + 1);
        self.visit(0..self.order.len(), at, k, &mut best);
        best.into_iter().map(|(squared, i): (f32, u32)| (squared.sqrt(), i)).collect()
    }

    fn visit(&self, range: Range<usize>, at: Vec3, k: usize, best: &mut Vec<(f32, u32)>) {
        if range.len() <= LEAF {
            self.order[range].iter().for_each(|&i| self.offer(i, at, k, best));
            return;
        }
        let middle = range.start + range.len() / 2;
        let (axis, place) = self.planes[middle];
        let offset = at[axis as usize] - place;
        let (low, high) = (range.start..middle, middle..range.end);
        let (near, far) = if offset < 0.0 { (low, high) } else { (high, low) };
        self.visit(near, at, k, best);
        if best.len() < k || best.last().is_some_and(|(d, _)| offset * offset <= *d) {
            self.visit(far, at, k, best);
        }
    }

    fn offer(&self, i: u32, at: Vec3, k: usize, best: &mut Vec<(f32, u32)>) {
        let entry = (self.points[i as usize].distance_squared(at), i);
        let place = best.partition_point(|b| b.0.total_cmp(&entry.0).then(b.1.cmp(&entry.1)).is_lt());
        if place < k {
            best.insert(place, entry);
            best.truncate(k);
        }
    }
}

fn split(points: &[Vec3], order: &mut [u32], planes: &mut [(u8, f32)]) {
    if order.len() <= LEAF {
        return;
    }
    let axis = largest_extent(points, order);
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b))
    });
    planes[middle] = (axis as u8, points[order[middle] as usize][axis]);
    let (low, high) = order.split_at_mut(middle);
    let (low_planes, high_planes) = planes.split_at_mut(middle);
    split(points, low, low_planes);
    // The middle of the upper half lies behind its first element, which holds this range's plane.
    split(points, high, high_planes);
}

fn largest_extent(points: &[Vec3], range: &[u32]) -> usize {
    let first = points[range[0] as usize];
    let (low, high) = range.iter().fold((first, first), |(low, high), &i| {
        let p = points[i as usize];
        (low.min(p), high.max(p))
    });
    (high - low).max_position()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn finds_what_a_full_search_finds(
            points in prop::collection::vec((-4i8..4, -4i8..4, -4i8..4), 1..200),
            at in (-5.0f32..5.0, -5.0f32..5.0, -5.0f32..5.0),
            k in 1usize..10,
        ) {
            let points: Vec<Vec3> =
                points.into_iter().map(|(x, y, z)| Vec3::new(f32::from(x), f32::from(y), f32::from(z))).collect();
            let at = Vec3::from(at);
            let mut all: Vec<(f32, u32)> =
                points.iter().enumerate().map(|(i, p)| (p.distance_squared(at).sqrt(), i as u32)).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            all.truncate(k);
            prop_assert_eq!(KdTree::new(&points).nearest(at, k), all);
        }
    }
}
