//! Components that are worth no face, and faces that nothing sees.

use std::collections::BTreeMap;

use super::Simplifier;
use crate::geometry::DisjointSets;

/// A component: its live faces and the mass of its vertices.
#[derive(Default)]
pub(super) struct Component {
    pub(super) faces: Vec<u32>,
    pub(super) mass: f64,
}

impl Simplifier {
    /// Removes components whose share of the mass is worth less than `faces` of `target`; together at most a fiftieth.
    pub(in crate::simplify) fn drop_negligible_components(&mut self, target: usize, faces: f64) {
        let components = self.components();
        let total: f64 = components.iter().map(|c| c.mass).sum();
        let mut left = total / 50.0;
        for component in &components {
            left -= component.mass;
            if component.mass * target as f64 >= faces * total || left < 0.0 {
                break;
            }
            self.remove(&component.faces);
        }
    }

    /// Removes the faces for which `unseen` holds, given the mesh as it stands and the faces' indices in it.
    pub(in crate::simplify) fn remove_faces(&mut self, unseen: &[bool]) {
        let live: Vec<u32> = self.live().collect();
        let dead: Vec<u32> = live.iter().zip(unseen).filter(|(_, dead)| **dead).map(|(&f, _)| f).collect();
        self.remove(&dead);
        self.split_pinched_vertices();
    }

    pub(super) fn remove(&mut self, faces: &[u32]) {
        for &f in faces {
            for v in self.kill(f) {
                self.stamps[v as usize] += 1;
            }
        }
    }

    pub(super) fn drop_smallest_components(&mut self, target: usize) {
        let components = self.components();
        let keep_last = components.len().saturating_sub(1);
        for component in components.into_iter().take(keep_last) {
            if self.live_faces <= target {
                break;
            }
            self.remove(&component.faces);
        }
    }

    /// Edge-connected components, the one with the least mass first.
    pub(super) fn components(&self) -> Vec<Component> {
        let mut sets = DisjointSets::new(self.positions.len());
        for f in self.live() {
            let [a, b, c] = self.faces[f as usize].vertices;
            sets.join(a as usize, b as usize);
            sets.join(b as usize, c as usize);
        }
        let mut by_root: BTreeMap<usize, Component> = BTreeMap::new();
        for f in self.live() {
            let root = sets.find(self.face(f)[0] as usize);
            by_root.entry(root).or_default().faces.push(f);
        }
        for v in 0..self.positions.len() {
            if let Some(component) = by_root.get_mut(&sets.find(v)) {
                // Vertices merged away have passed their mass on.
                if self.faces_of(v as u32).next().is_some() {
                    component.mass += self.mass[v];
                }
            }
        }
        let mut out: Vec<Component> = by_root.into_values().collect();
        out.sort_by(|a, b| a.mass.total_cmp(&b.mass).then(a.faces[0].cmp(&b.faces[0])));
        out
    }
}
