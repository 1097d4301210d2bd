//! A bounding box hierarchy over triangles that move one at a time.
//!
//! The triangles are sorted once by the Morton codes of their centres. The tree over that order is complete and
//! implicit: node `i` has the children `2 i` and `2 i + 1`. Moving a triangle refits one path to the root.

use glam::DVec3;

/// A bounding box hierarchy over triangles.
#[derive(Clone)]
pub(crate) struct FaceTree {
    /// The box of each node; the leaves are the second half, the root is node 1.
    boxes: Vec<Box3>,
    /// Triangle of each leaf, or [`NO_TRIANGLE`].
    triangles: Vec<u32>,
    /// Leaf of each triangle, or [`NO_LEAF`].
    leaves: Vec<u32>,
}

/// The triangle of an empty leaf.
const NO_TRIANGLE: u32 = u32::MAX;

/// The leaf of a triangle that the tree does not hold.
const NO_LEAF: u32 = u32::MAX;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Box3 {
    low: DVec3,
    high: DVec3,
}

impl Box3 {
    /// A box that overlaps no other and adds nothing to a union.
    const EMPTY: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// The bounding box of points.
    pub(crate) fn around(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| Self { low: b.low.min(p), high: b.high.max(p) })
    }

    /// The bounding box of both boxes.
    pub(crate) fn joined(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// True if the boxes overlap or touch.
    pub(crate) fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }
}

impl FaceTree {
    /// The tree over triangles, given by index and corners; every index lies below `capacity`.
    pub(crate) fn new(capacity: usize, faces: impl Iterator<Item = (u32, [DVec3; 3])>) -> Self {
        let mut items: Vec<(u64, u32, Box3)> = faces.map(|(f, corners)| (0, f, Box3::around(&corners))).collect();
        let all = items.iter().fold(Box3::EMPTY, |b, i| b.joined(i.2));
        let scale = (all.high - all.low).max_element().max(f64::MIN_POSITIVE).recip();
        for (code, _, b) in &mut items {
            *code = morton(((b.low + b.high) * 0.5 - all.low) * scale);
        }
        items.sort_unstable_by_key(|i| (i.0, i.1));
        let half = items.len().next_power_of_two().max(1);
        let mut out = Self {
            boxes: vec![Box3::EMPTY; 2 * half],
            triangles: vec![NO_TRIANGLE; half],
            leaves: vec![NO_LEAF; capacity],
        };
        for (leaf, (_, f, b)) in items.into_iter().enumerate() {
            out.triangles[leaf] = f;
            out.leaves[f as usize] = leaf as u32;
            out.boxes[half + leaf] = b;
        }
        for node in (1..half).rev() {
            out.boxes[node] = out.boxes[2 * node].joined(out.boxes[2 * node + 1]);
        }
        out
    }

    /// Moves a triangle.
    pub(crate) fn set(&mut self, triangle: u32, corners: &[DVec3; 3]) {
        self.put(triangle, Box3::around(corners));
    }

    /// Removes a triangle.
    pub(crate) fn remove(&mut self, triangle: u32) {
        self.put(triangle, Box3::EMPTY);
    }

    fn put(&mut self, triangle: u32, b: Box3) {
        let leaf = self.leaves[triangle as usize];
        if leaf == NO_LEAF {
            return;
        }
        let mut node = self.triangles.len() + leaf as usize;
        self.boxes[node] = b;
        while node > 1 {
            node /= 2;
            let joined = self.boxes[2 * node].joined(self.boxes[2 * node + 1]);
            if self.boxes[node] == joined {
                return;
            }
            self.boxes[node] = joined;
        }
    }

    /// True if `visit` returns true for a triangle whose box overlaps `range`; the first such triangle ends the search.
    pub(crate) fn any(&self, range: &Box3, mut visit: impl FnMut(u32) -> bool) -> bool {
        // Depth first over a complete tree: at most one node waits on each level.
        let mut waiting = [0usize; 40];
        let mut depth = 1;
        waiting[0] = 1;
        while depth > 0 {
            depth -= 1;
            let node = waiting[depth];
            if !self.boxes[node].meets(range) {
                continue;
            }
            match node.checked_sub(self.triangles.len()) {
                Some(leaf) => {
                    if visit(self.triangles[leaf]) {
                        return true;
                    }
                }
                None => {
                    waiting[depth] = 2 * node + 1;
                    waiting[depth + 1] = 2 * node;
                    depth += 2;
                }
            }
        }
        false
    }
}

/// The Morton code of a point of the unit cube, 21 bits for each coordinate.
fn morton(p: DVec3) -> u64 {
    let spread = |x: f64| {
        let mut v = (x.clamp(0.0, 1.0) * 2_097_151.0) as u64;
        v = (v | v << 32) & 0x001f_0000_0000_ffff;
        v = (v | v << 16) & 0x001f_0000_ff00_00ff;
        v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    };
    spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> [DVec3; 3] {
        [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| p * 0.5 + DVec3::X * x)
    }

    fn met(tree: &FaceTree, x: f64) -> Vec<u32> {
        let mut found = Vec::new();
        tree.any(&Box3::around(&at(x)), |f| {
            found.push(f);
            false
        });
        found.sort_unstable();
        found
    }

    #[test]
    fn neighbours_are_found_where_they_are_and_where_they_move() {
        let mut tree = FaceTree::new(9, (0..9).filter(|f| *f != 4).map(|f| (f, at(f64::from(f)))));
        assert_eq!(met(&tree, 2.1), [2]);
        assert!(met(&tree, 4.0).is_empty());
        tree.set(7, &at(2.0));
        assert_eq!(met(&tree, 2.1), [2, 7]);
        tree.remove(2);
        assert_eq!(met(&tree, 2.1), [7]);
        assert!(met(&tree, 7.0).is_empty());
    }

    #[test]
    fn an_empty_tree_meets_nothing() {
        assert!(met(&FaceTree::new(0, std::iter::empty()), 0.0).is_empty());
    }
}
