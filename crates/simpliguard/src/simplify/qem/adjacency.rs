//! Corner lists: the faces of each vertex, and which edges lie on the boundary.

use glam::DVec3;
use rayon::prelude::*;

use super::simplifier::{NO_CORNER, Simplifier};
use crate::geometry::DisjointSets;

impl Simplifier {
    /// The vertices of a face.
    pub(super) fn face(&self, f: u32) -> [u32; 3] {
        self.faces[f as usize].vertices
    }

    /// The positions of the vertices of a face.
    pub(super) fn corners(&self, f: u32) -> [DVec3; 3] {
        self.face(f).map(|v| self.positions[v as usize])
    }

    /// The next corner in the list of a corner's vertex, or [`NO_CORNER`].
    pub(super) fn after(&self, corner: u32) -> u32 {
        self.faces[corner as usize / 3].next[corner as usize % 3]
    }

    /// The faces that are not removed.
    pub(super) fn live(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.faces.len() as u32).filter(|&f| self.faces[f as usize].is_live())
    }

    /// Marks the neighbours of `u` except `except`.
    pub(super) fn mark_neighbours(&mut self, u: u32, except: u32, mark: u32) {
        let mut cursor = self.first[u as usize];
        while cursor != NO_CORNER {
            let face = self.faces[cursor as usize / 3];
            if face.is_live() {
                for w in face.vertices {
                    if w != u && w != except {
                        self.marks[w as usize] = mark;
                    }
                }
            }
            cursor = self.after(cursor);
        }
    }

    /// Makes `corners` the corner list of `u`.
    pub(super) fn relink(&mut self, u: u32, corners: &[u32]) {
        self.first[u as usize] = corners.first().copied().unwrap_or(NO_CORNER);
        for (i, &corner) in corners.iter().enumerate() {
            self.faces[corner as usize / 3].next[corner as usize % 3] =
                corners.get(i + 1).copied().unwrap_or(NO_CORNER);
        }
    }

    /// The live faces of a vertex, each with the index of the vertex in it.
    pub(super) fn faces_of(&self, v: u32) -> impl Iterator<Item = (u32, usize)> + '_ {
        let mut cursor = self.first[v as usize];
        std::iter::from_fn(move || {
            while cursor != NO_CORNER {
                let (corner, face) = (cursor, &self.faces[cursor as usize / 3]);
                cursor = face.next[corner as usize % 3];
                if face.is_live() {
                    return Some((corner / 3, corner as usize % 3));
                }
            }
            None
        })
    }

    /// The number of faces of an edge.
    pub(super) fn faces_of_edge(&self, u: u32, v: u32) -> usize {
        self.faces_of(u).filter(|(f, _)| self.face(*f).contains(&v)).count()
    }

    pub(super) fn is_boundary_edge(&self, u: u32, v: u32) -> bool {
        self.boundary[u as usize] && self.boundary[v as usize] && self.faces_of_edge(u, v) == 1
    }

    /// Finds the vertices on the boundary.
    pub(super) fn find_boundary(&mut self) {
        let this = &*self;
        self.boundary =
            (0..this.first.len() as u32).into_par_iter().with_min_len(1024).map(|v| this.is_boundary(v)).collect();
    }

    /// Finds the vertices on the boundary around `u`, after a collapse into `u` that may have closed a hole.
    pub(super) fn find_boundary_around(&mut self, u: u32) {
        let mut around: Vec<u32> = self.faces_of(u).flat_map(|(f, _)| self.face(f)).collect();
        around.push(u);
        for v in around {
            self.boundary[v as usize] = self.is_boundary(v);
        }
    }

    fn is_boundary(&self, v: u32) -> bool {
        // In a closed fan each neighbour occurs in two faces.
        self.faces_of(v).any(|(f, k)| {
            let face = self.face(f);
            self.faces_of_edge(v, face[(k + 1) % 3]) == 1 || self.faces_of_edge(v, face[(k + 2) % 3]) == 1
        })
    }

    /// Gives each fan of a vertex that is pinched a vertex of its own.
    pub(super) fn split_pinched_vertices(&mut self) {
        for v in 0..self.first.len() as u32 {
            let corners: Vec<u32> = self.faces_of(v).map(|(f, k)| 3 * f + k as u32).collect();
            for (n, fan) in self.fans(&corners).into_iter().enumerate() {
                if n == 0 {
                    self.relink(v, &fan);
                } else {
                    self.add_copy(v, &fan);
                }
            }
            self.stamps[v as usize] += 1;
        }
        self.find_boundary();
    }

    /// The corners of a vertex, grouped into fans: faces of one fan are connected by edges.
    fn fans(&self, corners: &[u32]) -> Vec<Vec<u32>> {
        let mut sets = DisjointSets::new(corners.len());
        for i in 0..corners.len() {
            for j in i + 1..corners.len() {
                let (a, b) = (self.face(corners[i] / 3), self.face(corners[j] / 3));
                if a.iter().filter(|w| b.contains(w)).count() >= 2 {
                    sets.join(i, j);
                }
            }
        }
        let members = sets.members().into_iter();
        members.map(|fan| fan.into_iter().map(|i| corners[i as usize]).collect()).collect()
    }

    /// Adds a vertex at the position of `v`, and gives it the corners of a fan.
    fn add_copy(&mut self, v: u32, fan: &[u32]) {
        let copy = self.positions.len() as u32;
        self.positions.push(self.positions[v as usize]);
        self.planes.push(self.planes[v as usize]);
        if let Some(&attribute) = self.attributes.get(v as usize) {
            self.attributes.push(attribute);
        }
        self.mass.push(0.0);
        self.first.push(NO_CORNER);
        self.boundary.push(true);
        self.stamps.push(0);
        self.marks.push(0);
        for &corner in fan {
            self.faces[corner as usize / 3].vertices[corner as usize % 3] = copy;
        }
        self.relink(copy, fan);
    }
}
