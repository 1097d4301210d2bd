//! The collapse of edges in the order of their errors.

use glam::DVec3;
use rayon::prelude::*;

use super::placement::edge_parameter;
use super::queue::{Precision, Queue};
use super::simplifier::{NO_CORNER, QueuedCollapse, Simplifier};

/// Least cosine between the normals of a face before and after a collapse.
const MIN_COSINE: f64 = 0.2;
/// The least cosine that lets faces flip.
const ANY_COSINE: f64 = -1.0;
/// Multiple of the target above which edges need not collapse in exact order.
const COARSE_ABOVE: usize = 4;

/// Limits on the change of the faces around a collapse.
#[derive(Clone, Copy)]
struct CollapseRules {
    /// Least cosine between the normals of a face before and after.
    min_cosine: f64,
    /// More pairs of faces may intersect after the collapse.
    may_intersect: bool,
}

impl Simplifier {
    /// Collapses until at most `target` faces are left or no collapse is possible. Returns the number of faces left.
    pub(crate) fn run(&mut self, target: usize) -> usize {
        self.collapse_without_flips(target);
        self.is_exhausted = self.has_to_go_on(target);
        if self.is_exhausted {
            self.fill_queue(Precision::Fine);
            self.collapse_to(target, CollapseRules { min_cosine: ANY_COSINE, may_intersect: true });
            self.remove_smallest_components(target);
        }
        self.live_faces
    }

    /// Collapses edges whose faces do not flip, until at most `target` faces are left or there are no more.
    pub(super) fn collapse_without_flips(&mut self, target: usize) {
        let strict = CollapseRules { min_cosine: MIN_COSINE, may_intersect: false };
        if self.live_faces > COARSE_ABOVE * target {
            self.fill_queue(Precision::Coarse);
            self.collapse_to(COARSE_ABOVE * target, strict);
        }
        self.fill_queue(Precision::Fine);
        self.collapse_to(target, strict);
        if self.has_to_go_on(target) && self.tree.is_some() {
            self.is_stuck = true;
            self.fill_queue(Precision::Fine);
            self.collapse_to(target, CollapseRules { min_cosine: MIN_COSINE, may_intersect: true });
        }
    }

    fn has_to_go_on(&self, target: usize) -> bool {
        self.live_faces > target && !self.cancellation.is_cancelled()
    }

    /// Fills the queue anew with all edges.
    fn fill_queue(&mut self, precision: Precision) {
        let faces: Vec<u32> = self.live().collect();
        let this = &*self;
        let lists = faces
            .par_iter()
            .with_min_len(1024)
            .flat_map_iter(|&f| {
                let face = this.face(f);
                // Both faces of an inner edge see it, in opposite directions: it counts once.
                let edges = (0..3).map(move |k| (face[k], face[(k + 1) % 3]));
                let once = edges.filter(|&(u, v)| u < v || this.is_boundary_edge(u, v));
                once.map(|(u, v)| this.queued(u, v))
            })
            .collect_vec_list();
        self.queue = Queue::new(precision);
        for entry in lists.into_iter().flatten() {
            self.queue.push(entry.cost, entry);
        }
    }

    /// The entry of an edge.
    fn queued(&self, u: u32, v: u32) -> QueuedCollapse {
        let (u, v) = (u.min(v), u.max(v));
        QueuedCollapse { cost: self.placement(u, v).1 as f32, u, v, stamp: self.stamp(u, v), refused: 0 }
    }

    fn stamp(&self, u: u32, v: u32) -> u32 {
        self.stamps[u as usize].wrapping_add(self.stamps[v as usize])
    }

    /// Collapses the edges of the queue by the rules, until at most `target` faces are left.
    fn collapse_to(&mut self, target: usize, rules: CollapseRules) {
        while self.has_to_go_on(target) {
            let Some(entry) = self.queue.pop() else { return };
            let (u, v) = (entry.u, entry.v);
            if self.stamp(u, v) != entry.stamp {
                continue;
            }
            if !self.link_condition(u, v) {
                self.collapse_tetrahedron(&entry);
                continue;
            }
            let position = self.position_of(&entry);
            if self.keeps_faces(u, v, position, rules.min_cosine)
                && self.keeps_faces(v, u, position, rules.min_cosine)
                && (rules.may_intersect || !self.collapse_intersects_more(u, v, position))
            {
                self.collapse(u, v, position);
            } else {
                self.push_next_position(&entry);
            }
        }
    }

    /// Merges `v` into `u` at `position`, and renews the entries of the edges around it.
    fn collapse(&mut self, u: u32, v: u32, position: DVec3) {
        let (quadric, mass) = (self.quadric(v), self.mass[v as usize]);
        self.add_quadric(u, &quadric);
        self.mass[u as usize] += mass;
        if let Some(posed) = &mut self.posed {
            let t = edge_parameter(self.positions[u as usize], self.positions[v as usize], position);
            posed.merge(u, v, t);
        }
        self.positions[u as usize] = position;
        self.merge_corners(u, v);
        // Entries of `v` in the queue are out of date, too.
        self.stamps[u as usize] += 1;
        self.stamps[v as usize] += 1;
        if self.boundary[u as usize] || self.boundary[v as usize] {
            self.find_boundary_around(u);
        }
        self.push_edges_around(u);
    }

    /// Removes the faces of the edge `u v` and gives the other faces of `v` to `u`.
    fn merge_corners(&mut self, u: u32, v: u32) {
        let mut kept = std::mem::take(&mut self.kept);
        kept.clear();
        for (w, other) in [(u, v), (v, u)] {
            let mut cursor = self.first[w as usize];
            while cursor != NO_CORNER {
                let (f, k) = (cursor as usize / 3, cursor as usize % 3);
                if self.faces[f].is_live() {
                    if self.faces[f].vertices.contains(&other) {
                        self.remove_face(f as u32);
                    } else {
                        self.faces[f].vertices[k] = u;
                        kept.push(cursor);
                    }
                }
                cursor = self.after(cursor);
            }
        }
        if let Some(tree) = &mut self.tree {
            for &corner in &kept {
                let face = self.faces[corner as usize / 3].vertices;
                tree.set(corner / 3, &face.map(|w| self.positions[w as usize]));
            }
        }
        self.relink(u, &kept);
        self.kept = kept;
        self.first[v as usize] = NO_CORNER;
    }

    /// Removes a face; returns the vertices it had.
    pub(super) fn remove_face(&mut self, f: u32) -> [u32; 3] {
        self.live_faces -= 1;
        if let Some(tree) = &mut self.tree {
            tree.remove(f);
        }
        self.faces[f as usize].remove()
    }

    fn push_edges_around(&mut self, u: u32) {
        self.mark += 1;
        let mut cursor = self.first[u as usize];
        while cursor != NO_CORNER {
            // The list holds live faces only: it was relinked.
            for w in self.face(cursor / 3) {
                if w != u && self.marks[w as usize] != self.mark {
                    self.marks[w as usize] = self.mark;
                    let entry = self.queued(u, w);
                    self.queue.push(entry.cost, entry);
                }
            }
            cursor = self.after(cursor);
        }
    }
}
