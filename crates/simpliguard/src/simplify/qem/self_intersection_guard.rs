//! The guard against self-intersections: collapses and moves after which more pairs of faces would intersect.

use glam::DVec3;

use super::simplifier::Simplifier;
use crate::geometry::{Box3, FaceTree, intersect};

/// A face around a vertex or an edge, with the positions of its corners.
type PatchFace = (u32, [DVec3; 3]);

impl Simplifier {
    /// Watches self-intersections from here on: whatever makes more pairs of faces intersect is refused.
    pub(crate) fn watch_intersections(&mut self) {
        self.tree = Some(FaceTree::new(self.faces.len(), self.live().map(|f| (f, self.corners(f)))));
    }

    /// True if more pairs of faces would intersect with `u` and `v` collapsed to `position`.
    pub(super) fn collapse_intersects_more(&self, u: u32, v: u32, position: DVec3) -> bool {
        let Some(tree) = &self.tree else { return false };
        let (mut after, mut before) = (Vec::with_capacity(16), Vec::with_capacity(18));
        let of_v_alone = self.faces_of(v).filter(|(f, _)| !self.face(*f).contains(&u));
        for (f, k) in self.faces_of(u).chain(of_v_alone) {
            let corners = self.corners(f);
            before.push((f, corners));
            let face = self.face(f);
            if !(face.contains(&u) && face.contains(&v)) {
                let mut moved = corners;
                moved[k] = position;
                after.push((f, moved));
            }
        }
        self.intersects_more(tree, &before, &after)
    }

    /// True if more pairs of faces would intersect with `v` at `position`.
    pub(super) fn move_intersects_more(&self, v: u32, position: DVec3) -> bool {
        let Some(tree) = &self.tree else { return false };
        let before: Vec<PatchFace> = self.faces_of(v).map(|(f, _)| (f, self.corners(f))).collect();
        let mut after = before.clone();
        for ((_, k), (_, corners)) in self.faces_of(v).zip(&mut after) {
            corners[k] = position;
        }
        self.intersects_more(tree, &before, &after)
    }

    /// True if more pairs of faces would intersect with the patch `after` in place of the patch `before`.
    fn intersects_more(&self, tree: &FaceTree, before: &[PatchFace], after: &[PatchFace]) -> bool {
        let rest = |f: u32| before.iter().all(|(g, _)| *g != f);
        let count = |patch: &[PatchFace], limit: usize| self.count_intersections(tree, patch, rest, limit);
        // Most changes make no intersection: the first one is looked for alone.
        count(after, 1) > 0 && count(after, usize::MAX) > count(before, usize::MAX)
    }

    /// Number of pairs that intersect, within `patch` and between `patch` and the faces of `rest`. Stops at `limit`.
    fn count_intersections(
        &self,
        tree: &FaceTree,
        patch: &[PatchFace],
        rest: impl Fn(u32) -> bool,
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
                count += usize::from(rest(f) && intersect(corners, &self.corners(f)));
                count >= limit
            });
            if count >= limit {
                break;
            }
        }
        count
    }
}
