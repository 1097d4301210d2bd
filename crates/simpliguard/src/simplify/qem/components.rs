//! Removal of components and of faces.

use std::collections::{BTreeMap, HashSet};

use super::simplifier::Simplifier;
use crate::geometry::vertex_components;

/// Negligible components have together at most one part in this many of the mass.
const NEGLIGIBLE_SHARE: f64 = 50.0;

/// A connected component.
#[derive(Default)]
struct Component {
    /// Its live faces.
    faces: Vec<u32>,
    /// The sum of the mass of its vertices.
    mass: f64,
}

impl Simplifier {
    /// Removes components whose share of the mass is worth less than `faces` of `target` faces; together at most a
    /// fiftieth of the mass.
    pub(crate) fn remove_negligible_components(&mut self, target: usize, faces: f64) {
        let components = self.components();
        let total: f64 = components.iter().map(|c| c.mass).sum();
        let mut left = total / NEGLIGIBLE_SHARE;
        for component in &components {
            left -= component.mass;
            if component.mass * target as f64 >= faces * total || left < 0.0 {
                break;
            }
            self.remove_all(&component.faces);
        }
    }

    /// The mesh without the components that block a collapse to `target` faces. A lattice keeps faces around each of its
    /// holes, however far it is collapsed. Beside it, the other components would collapse to nothing. The components with
    /// the least mass for each face that they keep are removed first, and the best one stays. `None` if nothing blocks, or
    /// if the best one blocks by itself.
    pub(crate) fn without_blocking_components(&self, target: usize) -> Option<Self> {
        let mut collapsed = self.clone();
        collapsed.collapse_without_flips(target);
        let kept =
            |component: &Component| component.faces.iter().filter(|f| collapsed.faces[**f as usize].is_live()).count();
        let mut components: Vec<(usize, Component)> = self.components().into_iter().map(|c| (kept(&c), c)).collect();
        let worth = |(kept, component): &(usize, Component)| component.mass / (*kept).max(1) as f64;
        components.sort_by(|a, b| worth(a).total_cmp(&worth(b)).then(a.1.faces[0].cmp(&b.1.faces[0])));
        let mut left = collapsed.live_faces;
        let (mut out, keep_last) = (self.clone(), components.len().saturating_sub(1));
        for (kept, component) in components.iter().take(keep_last) {
            if left <= target {
                break;
            }
            left -= kept;
            out.remove_all(&component.faces);
        }
        (left <= target && out.live_faces < self.live_faces).then_some(out)
    }

    /// Removes the faces for which `unwanted` holds. They are numbered as in the present mesh.
    pub(crate) fn remove_faces(&mut self, unwanted: &[bool]) {
        let faces: Vec<u32> = self.live().zip(unwanted).filter(|(_, unwanted)| **unwanted).map(|(f, _)| f).collect();
        let edges = |&f: &u32| {
            let [a, b, c] = self.face(f);
            [[a, b], [b, c], [c, a]]
        };
        let removed: HashSet<[u32; 2]> = faces.iter().flat_map(edges).collect();
        self.remove_all(&faces);
        self.add_rim_quadrics(&removed);
        self.split_pinched_vertices();
    }

    /// Removes faces, and makes the entries of their edges in the queue out of date.
    pub(super) fn remove_all(&mut self, faces: &[u32]) {
        for &f in faces {
            for v in self.remove_face(f) {
                self.stamps[v as usize] += 1;
            }
        }
    }

    /// Removes the smallest components until at most `target` faces are left; the largest one stays.
    pub(super) fn remove_smallest_components(&mut self, target: usize) {
        let components = self.components();
        let keep_last = components.len().saturating_sub(1);
        for component in components.into_iter().take(keep_last) {
            if self.live_faces <= target {
                break;
            }
            self.remove_all(&component.faces);
        }
    }

    /// The connected components, the one with the least mass first.
    fn components(&self) -> Vec<Component> {
        let component_of = vertex_components(self.positions.len(), self.live().map(|f| self.face(f)));
        let mut components: BTreeMap<u32, Component> = BTreeMap::new();
        for f in self.live() {
            let component = component_of[self.face(f)[0] as usize];
            components.entry(component).or_default().faces.push(f);
        }
        for (v, component) in (0u32..).zip(&component_of) {
            // A vertex without faces has passed its mass on.
            if self.faces_of(v).next().is_some()
                && let Some(component) = components.get_mut(component)
            {
                component.mass += self.mass[v as usize];
            }
        }
        let mut out: Vec<Component> = components.into_values().collect();
        out.sort_by(|a, b| a.mass.total_cmp(&b.mass).then(a.faces[0].cmp(&b.faces[0])));
        out
    }
}
