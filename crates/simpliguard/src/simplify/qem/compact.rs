//! Renumbering without what was removed.

use super::queue::{Precision, Queue};
use super::simplifier::{Face, NO_CORNER, Simplifier};
use crate::data::gather;

/// The new number of what is gone.
const GONE: u32 = u32::MAX;

impl Simplifier {
    /// Drops removed faces, and vertices without faces, so that copies and passes over all faces cost what is left. What
    /// stays keeps its order, and so do the corners around each vertex: later collapses are the same.
    ///
    /// Poses must not be followed yet, nor self-intersections be watched.
    pub(crate) fn compact(&mut self) {
        debug_assert!(self.posed.is_none() && self.tree.is_none());
        let faces: Vec<u32> = self.live().collect();
        let vertices: Vec<u32> =
            (0..self.positions.len() as u32).filter(|&v| self.faces_of(v).next().is_some()).collect();
        let (new_face, new_vertex) = (inverse(&faces, self.faces.len()), inverse(&vertices, self.positions.len()));
        let mut first = vec![NO_CORNER; vertices.len()];
        let mut kept: Vec<Face> = faces
            .iter()
            .map(|&f| Face { vertices: self.face(f).map(|v| new_vertex[v as usize]), next: [NO_CORNER; 3] })
            .collect();
        for (new, &v) in vertices.iter().enumerate() {
            let mut link = &mut first[new];
            for (f, k) in self.faces_of(v) {
                let f = new_face[f as usize];
                *link = 3 * f + k as u32;
                link = &mut kept[f as usize].next[k];
            }
        }
        self.positions = gather(&self.positions, &vertices);
        self.planes = gather(&self.planes, &vertices);
        self.attributes = gather(&self.attributes, &vertices);
        self.mass = gather(&self.mass, &vertices);
        self.boundary = gather(&self.boundary, &vertices);
        self.stamps = gather(&self.stamps, &vertices);
        self.marks = gather(&self.marks, &vertices);
        (self.faces, self.first) = (kept, first);
        // The collapse to the next budget fills it anew.
        self.queue = Queue::new(Precision::Coarse);
    }
}

/// The place of each element of `kept`, by its value below `count`.
fn inverse(kept: &[u32], count: usize) -> Vec<u32> {
    let mut out = vec![GONE; count];
    kept.iter().zip(0..).for_each(|(&old, new)| out[old as usize] = new);
    out
}
