//! Which collapses leave a manifold (Dey et al. 1999) whose faces stay the right way up.

use glam::DVec3;

use super::quadric::Quadric;
use super::{Entry, NONE, Simplifier};

impl Simplifier {
    /// A component that is down to a tetrahedron vanishes as a whole, at the error of its collapse to a point.
    pub(super) fn collapse_tetrahedron(&mut self, entry: &Entry) {
        let mut vertices = vec![entry.u, entry.v];
        let mut faces = Vec::new();
        let mut at = 0;
        while at < vertices.len() {
            let around: Vec<u32> = self.faces_of(vertices[at]).map(|(f, _)| f).collect();
            if around.len() != 3 || vertices.len() > 4 {
                return;
            }
            for f in around {
                if !faces.contains(&f) {
                    faces.push(f);
                }
                for v in self.faces[f as usize].vertices {
                    if !vertices.contains(&v) {
                        vertices.push(v);
                    }
                }
            }
            at += 1;
        }
        let mut quadric = Quadric::default();
        vertices.iter().for_each(|&v| quadric.add(&self.quadric(v)));
        let middle = vertices.iter().map(|&v| self.positions[v as usize]).sum::<DVec3>() / vertices.len() as f64;
        let cost = quadric.error(middle) as f32;
        if entry.cost >= cost {
            self.remove(&faces);
        } else {
            self.queue.push(cost, Entry { cost, ..*entry });
        }
    }

    /// Whether the mesh stays a manifold of the same topology, save that a hole of three edges closes.
    pub(super) fn link_condition(&mut self, u: u32, v: u32) -> bool {
        let edge_faces = self.faces_of_edge(u, v);
        if edge_faces == 0 || edge_faces > 2 {
            return false;
        }
        if edge_faces == 2 && self.boundary[u as usize] && self.boundary[v as usize] {
            return false;
        }
        // Common neighbours must be the corners opposite to the edge, and not be joined on both sides.
        self.mark += 2;
        let (seen, shared) = (self.mark - 1, self.mark);
        self.mark_neighbours(u, v, seen);
        let (mut common, mut closing) = (0, 0);
        let (mut cursor, mut blocked) = (self.first[v as usize], false);
        while cursor != NONE {
            let face = self.faces[cursor as usize / 3].vertices;
            if face[0] != NONE {
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
                // A face of v whose other corners both neighbour u would fold onto a face of u.
                blocked |= !face.contains(&u)
                    && face.iter().all(|&w| w == v || self.marks[w as usize] >= seen)
                    && self.has_face_with(u, face, v);
            }
            cursor = self.after(cursor);
        }
        common == edge_faces + closing.min(1) && !blocked
    }

    /// Whether some face has all three corners.
    pub(super) fn has_face(&self, u: u32, v: u32, w: u32) -> bool {
        self.faces_of(u).any(|(f, _)| {
            let face = self.faces[f as usize].vertices;
            face.contains(&v) && face.contains(&w)
        })
    }

    /// Whether `u` has a face with the corners of `face` other than `v`.
    pub(super) fn has_face_with(&self, u: u32, face: [u32; 3], v: u32) -> bool {
        self.faces_of(u).any(|(f, _)| face.iter().all(|w| *w == v || self.faces[f as usize].vertices.contains(w)))
    }

    /// Whether the faces of `moved` that `other` is not part of stay the right way up when it moves to `place`.
    pub(super) fn keeps_faces(&self, moved: u32, other: u32, place: DVec3, max_turn: f64) -> bool {
        self.faces_of(moved).all(|(f, k)| {
            let face = self.faces[f as usize].vertices;
            if face.contains(&other) {
                return true;
            }
            let [a, b] = [face[(k + 1) % 3], face[(k + 2) % 3]].map(|v| self.positions[v as usize]);
            let before = self.positions[moved as usize];
            let (old, new) = ((a - before).cross(b - before), (a - place).cross(b - place));
            let longest = (a - place).length_squared().max((b - place).length_squared()).max((a - b).length_squared());
            new.length() > 1e-5 * longest && old.dot(new) >= max_turn * old.length() * new.length()
        })
    }
}
