//! Collapses after which the mesh would pass through itself.

use glam::DVec3;

use super::Simplifier;
use crate::geometry::{Box3, FaceTree, intersect};

impl Simplifier {
    /// Refuses from here on whatever makes more pairs of faces pass through each other.
    pub(in crate::simplify) fn watch_intersections(&mut self) {
        self.tree = Some(FaceTree::new(self.faces.len(), self.live().map(|f| (f, self.corners(f)))));
    }

    /// Whether that was too much to ask for a budget, and more pairs may pass through each other since.
    pub(in crate::simplify) fn is_stuck(&self) -> bool {
        self.stuck
    }

    pub(super) fn corners(&self, f: u32) -> [DVec3; 3] {
        self.faces[f as usize].vertices.map(|v| self.positions[v as usize])
    }

    /// Whether more pairs of faces would pass through each other with `u` and `v` collapsed to `place`.
    pub(super) fn intersects_more(&self, u: u32, v: u32, place: DVec3) -> bool {
        let Some(tree) = &self.tree else { return false };
        let (mut after, mut before) = (Vec::with_capacity(16), Vec::with_capacity(18));
        for (f, k) in
            self.faces_of(u).chain(self.faces_of(v).filter(|(f, _)| !self.faces[*f as usize].vertices.contains(&u)))
        {
            let corners = self.corners(f);
            before.push((f, corners));
            let face = self.faces[f as usize].vertices;
            if !(face.contains(&u) && face.contains(&v)) {
                let mut moved = corners;
                moved[k] = place;
                after.push((f, moved));
            }
        }
        let others = |f: u32| before.iter().all(|(g, _)| *g != f);
        let limit = usize::MAX;
        let made = self.pairs_through(tree, &after, others, 1);
        made > 0 && self.pairs_through(tree, &after, others, limit) > self.pairs_through(tree, &before, others, limit)
    }

    /// Whether more pairs of faces would pass through each other with `v` at `place`.
    pub(super) fn moving_intersects_more(&self, v: u32, place: DVec3) -> bool {
        let Some(tree) = &self.tree else { return false };
        let before: Vec<(u32, [DVec3; 3])> = self.faces_of(v).map(|(f, _)| (f, self.corners(f))).collect();
        let mut after = before.clone();
        for ((_, k), (_, corners)) in self.faces_of(v).zip(&mut after) {
            corners[k] = place;
        }
        let others = |f: u32| before.iter().all(|(g, _)| *g != f);
        let made = self.pairs_through(tree, &after, others, 1);
        made > 0
            && self.pairs_through(tree, &after, others, usize::MAX)
                > self.pairs_through(tree, &before, others, usize::MAX)
    }

    /// Number of pairs that pass through each other, of `patch` with itself and with the `others`; counts up to `limit`.
    fn pairs_through(
        &self,
        tree: &FaceTree,
        patch: &[(u32, [DVec3; 3])],
        others: impl Fn(u32) -> bool,
        limit: usize,
    ) -> usize {
        let mut count = 0;
        for (i, (_, corners)) in patch.iter().enumerate() {
            count += patch[..i].iter().filter(|(_, other)| intersect(corners, other)).count();
            if count >= limit {
                return count;
            }
        }
        for (_, corners) in patch {
            tree.any(&Box3::around(corners), |f| {
                count += usize::from(others(f) && intersect(corners, &self.corners(f)));
                count >= limit
            });
            if count >= limit {
                break;
            }
        }
        count
    }
}
