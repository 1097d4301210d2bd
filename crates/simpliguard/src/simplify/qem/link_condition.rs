//! Tests of a collapse: the mesh stays a manifold (Dey et al. 1999), and no face flips.

use glam::DVec3;

use super::quadric::Quadric;
use super::simplifier::{NO_CORNER, QueuedCollapse, Simplifier};
use crate::geometry::area_vector;

/// Least area of a face after a collapse: twice the area, as a fraction of the squared longest edge.
const MIN_AREA: f64 = 1e-5;

impl Simplifier {
    /// Removes a component that is down to a tetrahedron, at the error of its collapse to a point. Does nothing for an
    /// edge of a larger component.
    pub(super) fn collapse_tetrahedron(&mut self, entry: &QueuedCollapse) {
        let mut vertices = vec![entry.u, entry.v];
        let mut faces = Vec::new();
        let mut visited = 0;
        while visited < vertices.len() {
            let around: Vec<u32> = self.faces_of(vertices[visited]).map(|(f, _)| f).collect();
            if around.len() != 3 || vertices.len() > 4 {
                return;
            }
            for f in around {
                if !faces.contains(&f) {
                    faces.push(f);
                }
                for v in self.face(f) {
                    if !vertices.contains(&v) {
                        vertices.push(v);
                    }
                }
            }
            visited += 1;
        }
        let mut quadric = Quadric::default();
        vertices.iter().for_each(|&v| quadric.add(&self.quadric(v)));
        let middle = vertices.iter().map(|&v| self.positions[v as usize]).sum::<DVec3>() / vertices.len() as f64;
        let cost = quadric.error(middle) as f32;
        if entry.cost >= cost {
            self.remove_all(&faces);
        } else {
            self.queue.push(cost, QueuedCollapse { cost, ..*entry });
        }
    }

    /// True if the mesh stays a manifold of the same topology after the edge collapses, except that a hole of three
    /// edges may close.
    pub(super) fn link_condition(&mut self, u: u32, v: u32) -> bool {
        let edge_faces = self.faces_of_edge(u, v);
        if edge_faces == 0 || edge_faces > 2 {
            return false;
        }
        if edge_faces == 2 && self.boundary[u as usize] && self.boundary[v as usize] {
            return false;
        }
        // Common neighbours must be the corners opposite to the edge.
        self.mark += 2;
        let (seen, shared) = (self.mark - 1, self.mark);
        self.mark_neighbours(u, v, seen);
        let (mut common, mut closing) = (0, 0);
        let (mut cursor, mut blocked) = (self.first[v as usize], false);
        while cursor != NO_CORNER {
            let face = self.faces[cursor as usize / 3];
            if face.is_live() {
                let face = face.vertices;
                for w in face {
                    if w != u && w != v && self.marks[w as usize] == seen {
                        self.marks[w as usize] = shared;
                        common += 1;
                        let hole = edge_faces == 1
                            && !self.has_face(u, v, w)
                            && self.faces_of_edge(u, w) == 1
                            && self.faces_of_edge(v, w) == 1;
                        closing += usize::from(hole);
                    }
                }
                // A face of v would fold onto a face of u with the same other corners.
                blocked |= !face.contains(&u)
                    && face.iter().all(|&w| w == v || self.marks[w as usize] >= seen)
                    && self.has_face_with(u, face, v);
            }
            cursor = self.after(cursor);
        }
        common == edge_faces + closing.min(1) && !blocked
    }

    /// True if a face has these three corners.
    fn has_face(&self, u: u32, v: u32, w: u32) -> bool {
        self.faces_of(u).any(|(f, _)| {
            let face = self.face(f);
            face.contains(&v) && face.contains(&w)
        })
    }

    /// True if `u` has a face with the corners of `face` other than `v`.
    fn has_face_with(&self, u: u32, face: [u32; 3], v: u32) -> bool {
        self.faces_of(u).any(|(f, _)| face.iter().all(|w| *w == v || self.face(f).contains(w)))
    }

    /// True if the faces of `moved` that do not contain `other` keep an area and do not flip when `moved` goes to
    /// `position`. `min_cosine` is the least cosine between the normals of a face before and after.
    pub(super) fn keeps_faces(&self, moved: u32, other: u32, position: DVec3, min_cosine: f64) -> bool {
        self.faces_of(moved).all(|(f, k)| {
            let face = self.face(f);
            if face.contains(&other) {
                return true;
            }
            let [a, b] = [face[(k + 1) % 3], face[(k + 2) % 3]].map(|v| self.positions[v as usize]);
            let before = self.positions[moved as usize];
            let (old, new) = (area_vector(&[before, a, b]), area_vector(&[position, a, b]));
            let squares = [a - position, b - position, a - b].map(|edge| edge.length_squared());
            let longest = squares[0].max(squares[1]).max(squares[2]);
            new.length() > MIN_AREA * longest && old.dot(new) >= min_cosine * old.length() * new.length()
        })
    }
}
