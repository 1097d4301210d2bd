//! Resolves shallow self-intersections by moving vertices.
//!
//! Shells that lie close together, such as a car's body and what is glued to it, begin to intersect as their faces
//! grow. Contacts are resolved one after another, like the constraints of position based dynamics (Müller et al. 2007):
//! only the part of each face over the other counts, and both faces move by the least displacement that puts it on one
//! side. Faces that intersect deeply, such as an arm in a body, stay as they are.

use std::collections::{BTreeSet, HashSet};

use glam::DVec3;

use super::contact::Contact;
use super::simplifier::Simplifier;
use crate::geometry::self_intersection::WORTH_RESOLUTION;
use crate::geometry::{Box3, area_vector, intersect};

/// Most rounds over all contacts.
const ROUNDS: usize = 80;
/// Rounds without progress after which resolution ends.
const PATIENCE: usize = 16;
/// Factor on the depth of a contact by which its faces move: contacts pull at each other.
const OVER_RELAXATION: f64 = 1.5;
/// Gap that is left between two faces, in the unit sphere.
const GAP: f64 = 1e-4;
/// Largest displacement of a vertex, as a fraction of the mean length of its edges.
const MAX_DISPLACEMENT: f64 = 0.5;
/// Least cosine between the normals of a face before and after resolution.
const MIN_COSINE: f64 = 0.5;
/// Fractions of its displacement that a moved vertex may keep.
const KEPT_FRACTIONS: [f64; 4] = [0.0, 0.25, 0.5, 0.75];
/// Rounds in which vertices move back.
const ROUNDS_BACK: usize = 2;

/// Limits of the displacements.
struct Limits<'a> {
    /// Positions before resolution.
    start: &'a [DVec3],
    /// Depth up to which contacts are resolved, in the unit sphere.
    depth: f64,
}

impl Simplifier {
    /// Moves vertices until fewer faces, at best none, are self-intersecting, and watches self-intersections from here
    /// on. Contacts up to a depth of `depth` mean edge lengths are resolved.
    pub(crate) fn resolve_intersections(&mut self, depth: f64) {
        if self.tree.is_none() {
            self.watch_intersections();
        }
        let start = self.positions.clone();
        if let Some(best) = self.least_intersecting_positions(&start, depth) {
            self.positions = best;
            self.watch_intersections();
            self.move_back(&start);
        }
    }

    /// The positions with the fewest self-intersecting faces; `None` if no vertex moves.
    fn least_intersecting_positions(&mut self, start: &[DVec3], depth: f64) -> Option<Vec<DVec3>> {
        let faces: Vec<u32> = self.live().collect();
        let limits = Limits { start, depth: depth * self.mean_edge_length(&faces) };
        let mut pairs = self.intersecting_pairs(&faces.iter().copied().collect());
        // Pairs that cannot be resolved wait until one of their faces moves.
        let mut waiting: Vec<(u32, u32)> = Vec::new();
        let (mut fewest, mut best, mut rounds_since) = (count_faces(&pairs, &[]), None, 0);
        if fewest as f64 > WORTH_RESOLUTION * faces.len() as f64 {
            return None;
        }
        for _ in 0..ROUNDS {
            let mut moved: BTreeSet<u32> = BTreeSet::new();
            for &pair in &pairs {
                self.separate(pair, &limits, &mut moved);
            }
            if moved.is_empty() || self.cancellation.is_cancelled() {
                break;
            }
            waiting.append(&mut pairs);
            waiting.retain(|(a, b)| !moved.contains(a) && !moved.contains(b));
            pairs = self.intersecting_pairs(&moved);
            let intersecting = count_faces(&pairs, &waiting);
            rounds_since += 1;
            if intersecting < fewest {
                (fewest, best, rounds_since) = (intersecting, Some(self.positions.clone()), 0);
            }
            if pairs.is_empty() || rounds_since > PATIENCE {
                break;
            }
        }
        best.or_else(|| (self.positions != start).then(|| start.to_vec()))
    }

    /// Pairs of intersecting faces, at least one of them in `faces`.
    fn intersecting_pairs(&self, faces: &BTreeSet<u32>) -> Vec<(u32, u32)> {
        let mut pairs = Vec::new();
        let Some(tree) = &self.tree else { return pairs };
        for &f in faces {
            let corners = self.corners(f);
            tree.any(&Box3::around(&corners), |g| {
                if g != f && !(g < f && faces.contains(&g)) && intersect(&corners, &self.corners(g)) {
                    pairs.push((f.min(g), f.max(g)));
                }
                false
            });
        }
        pairs.sort_unstable();
        pairs
    }

    fn mean_edge_length(&self, faces: &[u32]) -> f64 {
        let edges = |&f: &u32| {
            let corners = self.corners(f);
            (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).sum::<f64>()
        };
        faces.iter().map(edges).sum::<f64>() / (3 * faces.len().max(1)) as f64
    }

    /// Separates two faces, unless their contact is too deep. Corners that would flip a face stay where they are. Adds
    /// the faces that move to `moved`.
    fn separate(&mut self, (a, b): (u32, u32), limits: &Limits<'_>, moved: &mut BTreeSet<u32>) {
        let contact = Contact::between(&self.corners(a), &self.corners(b));
        let Some(contact) = contact.filter(|contact| contact.depth <= limits.depth) else { return };
        let mut weights: Vec<(u32, f64)> = Vec::with_capacity(6);
        for (v, weight) in self.face(a).into_iter().chain(self.face(b)).zip(contact.weights) {
            match weights.iter_mut().find(|other| other.0 == v) {
                Some(shared) => shared.1 += weight,
                None => weights.push((v, weight)),
            }
        }
        while let Some(positions) = self.separated_positions(&contact, &weights, limits.start) {
            let before: Vec<DVec3> = weights.iter().map(|(v, _)| self.positions[*v as usize]).collect();
            weights.iter().zip(&positions).for_each(|((v, _), position)| self.positions[*v as usize] = *position);
            let flipping: Vec<u32> =
                weights.iter().map(|(v, _)| *v).filter(|&v| self.flips_around(v, limits.start)).collect();
            if flipping.is_empty() {
                for ((&(v, _), position), before) in weights.iter().zip(positions).zip(before) {
                    if position != before {
                        moved.extend(self.faces_of(v).map(|(f, _)| f));
                        self.move_vertex(v, position);
                    }
                }
                return;
            }
            weights.iter().zip(before).for_each(|((v, _), position)| self.positions[*v as usize] = position);
            weights.retain(|(v, _)| !flipping.contains(v));
        }
    }

    /// The positions to which a contact moves the vertices with `weights`; `None` if these vertices cannot resolve it.
    fn separated_positions(&self, contact: &Contact, weights: &[(u32, f64)], start: &[DVec3]) -> Option<Vec<DVec3>> {
        // A vertex of small faces moves farther than one of large faces.
        let lightness: Vec<f64> = weights.iter().map(|(v, _)| 1.0 / self.area_around(*v, start).max(1e-12)).collect();
        let norm: f64 = weights.iter().zip(&lightness).map(|((_, weight), light)| light * weight * weight).sum();
        let step = contact.direction * ((OVER_RELAXATION * contact.depth + GAP) / norm);
        let position = |(&(v, weight), light): (&(u32, f64), &f64)| {
            let origin = start[v as usize];
            let displacement = self.positions[v as usize] + step * (weight * light) - origin;
            origin + displacement.clamp_length_max(MAX_DISPLACEMENT * self.edge_length_around(v, start))
        };
        (norm > 0.0).then(|| weights.iter().zip(&lightness).map(position).collect())
    }

    /// Moves vertices back towards `start`, as far as no more pairs of faces intersect.
    fn move_back(&mut self, start: &[DVec3]) {
        for _ in 0..ROUNDS_BACK {
            for v in 0..start.len() as u32 {
                let (origin, position) = (start[v as usize], self.positions[v as usize]);
                if position == origin {
                    continue;
                }
                let gap = GAP / position.distance(origin);
                let is_free = |t: f64| !self.move_intersects_more(v, origin.lerp(position, t));
                if let Some(t) = KEPT_FRACTIONS.into_iter().find(|&t| is_free(t) && is_free(t - gap)) {
                    self.move_vertex(v, origin.lerp(position, t));
                }
            }
        }
    }

    fn move_vertex(&mut self, v: u32, position: DVec3) {
        self.positions[v as usize] = position;
        let corners: Vec<(u32, [DVec3; 3])> = self.faces_of(v).map(|(f, _)| (f, self.corners(f))).collect();
        if let Some(tree) = &mut self.tree {
            corners.iter().for_each(|(f, corners)| tree.set(*f, corners));
        }
    }

    /// The area of the faces of a vertex.
    fn area_around(&self, v: u32, positions: &[DVec3]) -> f64 {
        self.faces_of(v).map(|(f, _)| 0.5 * self.area_vector_at(f, positions).length()).sum()
    }

    /// The mean length of the edges of a vertex.
    fn edge_length_around(&self, v: u32, positions: &[DVec3]) -> f64 {
        let length = |w: u32| positions[w as usize].distance(positions[v as usize]);
        let (mut sum, mut count) = (0.0, 0);
        for (f, k) in self.faces_of(v) {
            let face = self.face(f);
            sum += length(face[(k + 1) % 3]) + length(face[(k + 2) % 3]);
            count += 2;
        }
        sum / f64::from(count.max(1))
    }

    /// True if a face of a vertex turns too far from its direction at `start`.
    fn flips_around(&self, v: u32, start: &[DVec3]) -> bool {
        self.faces_of(v).any(|(f, _)| {
            let (old, new) = (self.area_vector_at(f, start), self.area_vector_at(f, &self.positions));
            let keeps = old.dot(new) > MIN_COSINE * old.length() * new.length();
            !keeps
        })
    }

    fn area_vector_at(&self, f: u32, positions: &[DVec3]) -> DVec3 {
        area_vector(&self.face(f).map(|v| positions[v as usize]))
    }
}

/// Number of faces that occur in pairs.
fn count_faces(pairs: &[(u32, u32)], others: &[(u32, u32)]) -> usize {
    pairs.iter().chain(others).flat_map(|&(a, b)| [a, b]).collect::<HashSet<u32>>().len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::TriMesh;
    use crate::geometry::self_intersecting;
    use glam::Vec3;

    /// Squares of `2 n n` triangles on top of each other, at the given heights.
    fn sheets(n: u32, heights: [fn(f32, f32) -> f32; 2]) -> TriMesh {
        let mut mesh = TriMesh::default();
        for height in heights {
            let base = mesh.positions.len() as u32;
            let at = |i: u32| i as f32 / n as f32;
            let corners = (0..(n + 1) * (n + 1)).map(|i| (at(i % (n + 1)), at(i / (n + 1))));
            mesh.positions.extend(corners.map(|(x, y)| Vec3::new(x, y, height(x, y))));
            let quads = (0..n * n).map(|i| base + i / n * (n + 1) + i % n);
            mesh.triangles.extend(quads.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]));
        }
        mesh
    }

    fn count(mesh: &TriMesh) -> usize {
        self_intersecting(mesh).into_iter().filter(|face| *face).count()
    }

    /// The mesh with its contacts resolved, and the largest displacement of its vertices.
    fn resolved(mesh: &TriMesh, deepest: f64) -> (TriMesh, f64) {
        let mut simplifier = Simplifier::new(mesh, &vec![1.0; mesh.triangles.len()], 0.0);
        let start = simplifier.positions.clone();
        simplifier.resolve_intersections(deepest);
        let displacements = start.iter().zip(&simplifier.positions).map(|(a, b)| a.distance(*b));
        (simplifier.mesh(), displacements.fold(0.0, f64::max))
    }

    #[test]
    fn shells_that_cross_a_little_are_taken_apart() {
        let ripple = |x: f32, y: f32| 0.0036 + 0.004 * libm::sinf(20.0 * x) * libm::cosf(17.0 * y);
        let mesh = sheets(12, [|_, _| 0.0, ripple]);
        assert!((40..110).contains(&count(&mesh)));
        let (out, farthest) = resolved(&mesh, 0.1);
        assert_eq!(count(&out), 0);
        assert!(farthest < 0.01, "{farthest}");
    }

    #[test]
    fn what_passes_deep_or_not_at_all_stays() {
        let steep = sheets(4, [|_, _| 0.0, |x, _| 2.0 * (x - 0.45)]);
        assert!(count(&steep) > 0);
        assert_eq!(resolved(&steep, 0.1).1, 0.0);
        let apart = sheets(4, [|_, _| 0.0, |_, _| 0.1]);
        assert_eq!(resolved(&apart, 0.1).1, 0.0);
    }
}
