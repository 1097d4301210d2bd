//! Edge collapse by quadric error, on a mesh that stays a manifold.
//!
//! An edge may collapse if the link condition holds (Dey et al. 1999), no face turns over and none loses its area. When
//! no such edge is left the turn-over test is dropped, and last the smallest components go: a budget is only missed if
//! one component has too many handles.

mod adjacency;
mod components;
mod link;
mod motion;
#[cfg(test)]
mod tests;

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use self::motion::InMotion;
use super::quadric::Quadric;
use crate::mesh::TriMesh;

/// End of a corner list, and a dead face's vertex.
const NONE: u32 = u32::MAX;
/// Least cosine between a face's normal before and after a collapse.
const MAX_TURN: f64 = 0.2;
/// Weight of the planes that hold the boundary, against those of the faces beside it.
const BOUNDARY_WEIGHT: f64 = 3.0;

/// A mesh on its way down to a budget.
pub(super) struct Simplifier {
    positions: Vec<DVec3>,
    quadrics: Vec<Quadric>,
    /// Weight of what has collapsed into each vertex.
    mass: Vec<f64>,
    faces: Vec<[u32; 3]>,
    live_faces: usize,
    /// First corner (3 * face + k) of each vertex, and the corner after each; dead faces are skipped.
    first: Vec<u32>,
    next: Vec<u32>,
    /// Raised whenever a vertex changes; a heap entry with another stamp is out of date.
    stamps: Vec<u32>,
    heap: BinaryHeap<Reverse<Entry>>,
    /// Error in other poses, once they are followed.
    in_motion: Option<InMotion>,
    /// Scratch for the link condition.
    marks: Vec<u32>,
    mark: u32,
}

/// A possible collapse; ordered by cost, then by vertices.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    /// Bits of a non-negative float, which order as it does.
    cost: u32,
    u: u32,
    v: u32,
    stamps: (u32, u32),
}

/// Where `p` projects onto the edge from `a` to `b`, 0 to 1.
fn part_of_way(a: DVec3, b: DVec3, p: DVec3) -> f64 {
    let way = b - a;
    ((p - a).dot(way) / way.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}

impl Simplifier {
    /// Takes a manifold mesh, with or without boundary. `weights` multiply each face's quadric in place of its area;
    /// `curvature` is the weight of the curvature constraint. Positions should fit the unit sphere.
    pub(super) fn new(mesh: &TriMesh, weights: &[f64], curvature: f64) -> Self {
        let vertices = mesh.positions.len();
        let mut out = Self {
            positions: mesh.positions.iter().map(|p| p.as_dvec3()).collect(),
            quadrics: vec![Quadric::default(); vertices],
            mass: vec![0.0; vertices],
            live_faces: mesh.triangles.len(),
            faces: mesh.triangles.clone(),
            first: vec![NONE; vertices],
            next: vec![NONE; mesh.triangles.len() * 3],
            stamps: vec![0; vertices],
            heap: BinaryHeap::new(),
            in_motion: None,
            marks: vec![0; vertices],
            mark: 0,
        };
        for (corner, &v) in mesh.triangles.iter().flatten().enumerate() {
            out.next[corner] = out.first[v as usize];
            out.first[v as usize] = corner as u32;
        }
        out.add_face_quadrics(weights, curvature);
        out.add_boundary_quadrics(weights);
        out.fill_heap();
        out
    }

    /// Collapses until at most `target` faces are left or nothing more can be done; returns the number left.
    pub(super) fn run(&mut self, target: usize) -> usize {
        self.collapse_to(target, MAX_TURN);
        if self.live_faces > target {
            self.fill_heap();
            self.collapse_to(target, -1.0);
            self.drop_smallest_components(target);
            self.fill_heap();
        }
        self.live_faces
    }

    /// The mesh as it stands.
    pub(super) fn mesh(&self) -> TriMesh {
        let all = TriMesh {
            positions: self.positions.iter().map(|p| p.as_vec3()).collect::<Vec<Vec3>>(),
            triangles: self.live().map(|f| self.faces[f as usize]).collect(),
        };
        all.filtered(|_| true)
    }

    fn add_face_quadrics(&mut self, weights: &[f64], curvature: f64) {
        let curvatures = if curvature > 0.0 { self.vertex_curvatures() } else { Vec::new() };
        for (f, &weight) in weights.iter().enumerate() {
            let face = self.faces[f];
            let p = face.map(|v| self.positions[v as usize]);
            let n = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
            let mut quadric = Quadric::plane(n, -n.dot(p[0]), weight);
            if curvature > 0.0 {
                let c = face.map(|v| curvatures[v as usize]);
                quadric.add(&Quadric::curvature(p, n, c, weight * curvature));
            }
            for v in face {
                self.quadrics[v as usize].add(&quadric);
                self.mass[v as usize] += weight;
            }
        }
    }

    /// The paper's curvature, `1 / sum_j angle(n, N_j)`: low on ridges and creases, one on flats. The printed form is
    /// infinite there, hence the small angle and the scaling to at most one.
    fn vertex_curvatures(&self) -> Vec<f64> {
        const SMALLEST_ANGLE: f64 = 1e-3;
        let normal = |f: usize| {
            let p = self.faces[f].map(|v| self.positions[v as usize]);
            (p[1] - p[0]).cross(p[2] - p[0])
        };
        (0..self.positions.len())
            .into_par_iter()
            .map(|v| {
                let mean = self.faces_of(v as u32).map(|(f, _)| normal(f as usize)).sum::<DVec3>().normalize_or_zero();
                let angles: f64 = self
                    .faces_of(v as u32)
                    .map(|(f, _)| libm::acos(mean.dot(normal(f as usize).normalize_or_zero()).clamp(-1.0, 1.0)))
                    .sum();
                SMALLEST_ANGLE / (angles + SMALLEST_ANGLE)
            })
            .collect()
    }

    fn add_boundary_quadrics(&mut self, weights: &[f64]) {
        for (f, &weight) in weights.iter().enumerate() {
            let face = self.faces[f];
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                if self.faces_of_edge(a, b) != 1 {
                    continue;
                }
                let [pa, pb, pc] = [a, b, face[(k + 2) % 3]].map(|v| self.positions[v as usize]);
                let normal = (pb - pa).cross(pc - pa);
                let n = (pb - pa).cross(normal).normalize_or_zero();
                let quadric = Quadric::plane(n, -n.dot(pa), BOUNDARY_WEIGHT * weight);
                self.quadrics[a as usize].add(&quadric);
                self.quadrics[b as usize].add(&quadric);
            }
        }
    }

    fn fill_heap(&mut self) {
        let faces: Vec<u32> = self.live().collect();
        let this = &*self;
        let entries: Vec<Reverse<Entry>> = faces
            .par_iter()
            .with_min_len(1024)
            .flat_map_iter(|&f| {
                let face = this.faces[f as usize];
                // The other face of an inner edge sees it the other way round.
                let edges = (0..3).map(move |k| (face[k], face[(k + 1) % 3]));
                let once = edges.filter(|&(u, v)| u < v || this.faces_of_edge(u, v) == 1);
                once.map(|(u, v)| Reverse(this.entry(u, v)))
            })
            .collect();
        self.heap = BinaryHeap::from(entries);
    }

    fn entry(&self, u: u32, v: u32) -> Entry {
        let (u, v) = (u.min(v), u.max(v));
        let cost = (self.placement(u, v).1 as f32).to_bits();
        Entry { cost, u, v, stamps: (self.stamps[u as usize], self.stamps[v as usize]) }
    }

    /// Where the edge would collapse to, and the error there.
    fn placement(&self, u: u32, v: u32) -> (DVec3, f64) {
        let mut quadric = self.quadrics[u as usize];
        quadric.add(&self.quadrics[v as usize]);
        let (a, b) = (self.positions[u as usize], self.positions[v as usize]);
        let (middle, length) = ((a + b) * 0.5, a.distance(b));
        // On flats, where every place is as good, short edges go first.
        let tie = 1e-9 * length.powi(4);
        let in_motion = |p: DVec3| self.in_motion.as_ref().map_or(0.0, |m| m.error(u, v, part_of_way(a, b, p), p));
        let minimum = quadric.minimum().filter(|p| p.distance(middle) < 2.0 * length);
        if let Some(p) = minimum.filter(|_| self.in_motion.is_none()) {
            return (p, quadric.error(p) + tie);
        }
        let candidates = [minimum.unwrap_or(middle), middle, a, b].map(|p| (p, quadric.error(p) + in_motion(p)));
        let best = candidates.into_iter().reduce(|best, c| if c.1 < best.1 { c } else { best });
        best.map_or((middle, tie), |(p, error)| (p, error + tie))
    }

    fn collapse_to(&mut self, target: usize, max_turn: f64) {
        while self.live_faces > target {
            let Some(Reverse(entry)) = self.heap.pop() else { return };
            let (u, v) = (entry.u, entry.v);
            if self.first[u as usize] == NONE
                || self.first[v as usize] == NONE
                || (self.stamps[u as usize], self.stamps[v as usize]) != entry.stamps
            {
                continue;
            }
            if !self.link_condition(u, v) {
                self.collapse_tetrahedron(&entry);
                continue;
            }
            let (place, _) = self.placement(u, v);
            if self.keeps_faces(u, v, place, max_turn) && self.keeps_faces(v, u, place, max_turn) {
                self.collapse(u, v, place);
            }
        }
    }

    fn collapse(&mut self, u: u32, v: u32, place: DVec3) {
        let (quadric, mass) = (self.quadrics[v as usize], self.mass[v as usize]);
        self.quadrics[u as usize].add(&quadric);
        self.mass[u as usize] += mass;
        if let Some(in_motion) = &mut self.in_motion {
            let t = part_of_way(self.positions[u as usize], self.positions[v as usize], place);
            in_motion.merge(u, v, t);
        }
        self.positions[u as usize] = place;
        let mut kept = Vec::with_capacity(16);
        for (w, corners) in [(u, self.corners_of(u)), (v, self.corners_of(v))] {
            for corner in corners {
                let (f, k) = (corner as usize / 3, corner as usize % 3);
                let other = if w == u { v } else { u };
                if self.faces[f][0] == NONE {
                    continue;
                }
                if self.faces[f].contains(&other) {
                    self.faces[f] = [NONE; 3];
                    self.live_faces -= 1;
                } else {
                    self.faces[f][k] = u;
                    kept.push(corner);
                }
            }
        }
        self.relink(u, &kept);
        self.first[v as usize] = NONE;
        self.stamps[u as usize] += 1;
        self.push_edges_around(u);
    }

    fn push_edges_around(&mut self, u: u32) {
        self.mark += 1;
        for corner in self.corners_of(u) {
            let face = self.faces[corner as usize / 3];
            if face[0] == NONE {
                continue;
            }
            for w in face {
                if w != u && self.marks[w as usize] != self.mark {
                    self.marks[w as usize] = self.mark;
                    self.heap.push(Reverse(self.entry(u, w)));
                }
            }
        }
    }
}
