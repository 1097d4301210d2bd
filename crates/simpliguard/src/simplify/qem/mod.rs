//! Edge collapse by quadric error, on a mesh that stays a manifold.
//!
//! An edge may collapse if the link condition holds (Dey et al. 1999), no face turns over, none loses its area and, once
//! that is watched, no more faces pass through each other. Where no such edge is left the last test is dropped first,
//! then the turn-over test, and at the end the smallest components go: a budget is only missed if one component has too
//! many handles.

mod adjacency;
mod components;
mod flip_guard;
mod link;
mod motion;
mod placement;
mod quadric;
mod queue;
mod resolve_intersections;
#[cfg(test)]
mod tests;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use self::motion::InMotion;
use self::placement::part_of_way;
use self::quadric::{Attribute, Planes, Quadric};
use self::queue::{Precision, Queue};
use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::FaceTree;

/// End of a corner list, and a dead face's vertex.
const NONE: u32 = u32::MAX;
/// Least cosine between a face's normal before and after a collapse.
const MAX_TURN: f64 = 0.2;
/// Multiple of the target above which edges need not collapse in exact order.
const COARSE_ABOVE: usize = 4;
/// Weight of the planes that hold the boundary, against those of the faces beside it.
const BOUNDARY_WEIGHT: f64 = 3.0;

/// A mesh on its way down to a budget.
#[derive(Clone)]
pub(super) struct Simplifier {
    positions: Vec<DVec3>,
    /// Quadrics of the distance to planes, and of the curvature, empty without a weight for it.
    planes: Vec<Planes>,
    attributes: Vec<Attribute>,
    /// Weight of what has collapsed into each vertex.
    mass: Vec<f64>,
    faces: Vec<Face>,
    live_faces: usize,
    /// First corner (3 * face + k) of each vertex.
    first: Vec<u32>,
    /// Whether a vertex lies on the boundary.
    boundary: Vec<bool>,
    /// Raised whenever a vertex changes; an entry with another sum of stamps is out of date.
    stamps: Vec<u32>,
    queue: Queue<Entry>,
    /// Error in other poses, once they are followed.
    in_motion: Option<InMotion>,
    /// Where the faces are, once self-intersections matter.
    tree: Option<FaceTree>,
    /// A budget could only be met by faces that cross.
    stuck: bool,
    /// Scratch for the link condition.
    marks: Vec<u32>,
    mark: u32,
    /// Scratch for a collapse: corners that stay.
    kept: Vec<u32>,
    cancellation: Cancellation,
}

/// A face, dead if its first vertex is [`NONE`].
#[derive(Clone, Copy)]
struct Face {
    vertices: [u32; 3],
    /// For each corner the one after it in the list of their vertex, where dead faces are skipped, or [`NONE`].
    next: [u32; 3],
}

/// A possible collapse.
#[derive(Clone, Copy)]
struct Entry {
    cost: f32,
    u: u32,
    v: u32,
    /// Sum of both stamps: they only rise.
    stamp: u32,
    /// Places that were refused.
    refused: u32,
}

/// What a collapse may do to the faces around it.
#[derive(Clone, Copy)]
struct Rules {
    /// Least cosine between a face's normal before and after.
    max_turn: f64,
    /// More faces may pass through each other.
    may_intersect: bool,
}

impl Simplifier {
    /// Takes a manifold mesh, with or without boundary. `weights` multiply each face's quadric in place of its area;
    /// `curvature` is the weight of the curvature constraint. Positions should fit the unit sphere.
    pub(super) fn new(mesh: &TriMesh, weights: &[f64], curvature: f64) -> Self {
        let vertices = mesh.positions.len();
        let mut out = Self {
            positions: mesh.positions.iter().map(|p| p.as_dvec3()).collect(),
            planes: vec![Planes::default(); vertices],
            attributes: vec![Attribute::default(); if curvature > 0.0 { vertices } else { 0 }],
            mass: vec![0.0; vertices],
            live_faces: mesh.triangles.len(),
            faces: mesh.triangles.iter().map(|&vertices| Face { vertices, next: [NONE; 3] }).collect(),
            first: vec![NONE; vertices],
            boundary: Vec::new(),
            stamps: vec![0; vertices],
            queue: Queue::new(Precision::Coarse),
            in_motion: None,
            tree: None,
            stuck: false,
            marks: vec![0; vertices],
            mark: 0,
            kept: Vec::new(),
            cancellation: Cancellation::default(),
        };
        for (corner, &v) in mesh.triangles.iter().flatten().enumerate() {
            out.faces[corner / 3].next[corner % 3] = out.first[v as usize];
            out.first[v as usize] = corner as u32;
        }
        out.find_boundary();
        out.add_face_quadrics(weights, curvature);
        out.add_boundary_quadrics(weights);
        out
    }

    /// Leaves faces where they are once `cancellation` is set.
    pub(super) fn stop_with(&mut self, cancellation: &Cancellation) {
        self.cancellation = cancellation.clone();
    }

    /// Collapses until at most `target` faces are left or nothing more can be done; returns the number left.
    pub(super) fn run(&mut self, target: usize) -> usize {
        let strict = Rules { max_turn: MAX_TURN, may_intersect: false };
        if self.live_faces > COARSE_ABOVE * target {
            self.fill_queue(Precision::Coarse);
            self.collapse_to(COARSE_ABOVE * target, strict);
        }
        self.fill_queue(Precision::Fine);
        self.collapse_to(target, strict);
        if self.has_to_go_on(target) && self.tree.is_some() {
            self.stuck = true;
            self.fill_queue(Precision::Fine);
            self.collapse_to(target, Rules { max_turn: MAX_TURN, may_intersect: true });
        }
        if self.has_to_go_on(target) {
            self.fill_queue(Precision::Fine);
            self.collapse_to(target, Rules { max_turn: -1.0, may_intersect: true });
            self.drop_smallest_components(target);
        }
        self.live_faces
    }

    /// Number of faces as it stands.
    pub(super) fn faces(&self) -> usize {
        self.live_faces
    }

    fn has_to_go_on(&self, target: usize) -> bool {
        self.live_faces > target && !self.cancellation.is_cancelled()
    }

    /// The mesh as it stands.
    pub(super) fn mesh(&self) -> TriMesh {
        let all = TriMesh {
            positions: self.positions.iter().map(|p| p.as_vec3()).collect::<Vec<Vec3>>(),
            triangles: self.live().map(|f| self.faces[f as usize].vertices).collect(),
        };
        all.filtered(|_| true)
    }

    fn add_face_quadrics(&mut self, weights: &[f64], curvature: f64) {
        let curvatures = if curvature > 0.0 { self.vertex_curvatures() } else { Vec::new() };
        for (f, &weight) in weights.iter().enumerate() {
            let face = self.faces[f].vertices;
            let p = face.map(|v| self.positions[v as usize]);
            let n = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
            let mut quadric = Quadric::plane(n, -n.dot(p[0]), weight);
            if curvature > 0.0 {
                let c = face.map(|v| curvatures[v as usize]);
                quadric.add(&Quadric::curvature(p, n, c, weight * curvature));
            }
            for v in face {
                self.add_quadric(v, &quadric);
                self.mass[v as usize] += weight;
            }
        }
    }

    fn quadric(&self, v: u32) -> Quadric {
        Quadric {
            planes: self.planes[v as usize],
            attribute: self.attributes.get(v as usize).copied().unwrap_or_default(),
        }
    }

    fn add_quadric(&mut self, v: u32, quadric: &Quadric) {
        self.planes[v as usize].add(&quadric.planes);
        if let Some(attribute) = self.attributes.get_mut(v as usize) {
            attribute.add(&quadric.attribute);
        }
    }

    /// The paper's curvature, `1 / sum_j angle(n, N_j)`: low on ridges and creases, one on flats. The printed form is
    /// infinite there, hence the small angle and the scaling to at most one.
    fn vertex_curvatures(&self) -> Vec<f64> {
        const SMALLEST_ANGLE: f64 = 1e-3;
        let normal = |f: usize| {
            let p = self.faces[f].vertices.map(|v| self.positions[v as usize]);
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
            let face = self.faces[f].vertices;
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                if !self.is_boundary_edge(a, b) {
                    continue;
                }
                let [pa, pb, pc] = [a, b, face[(k + 2) % 3]].map(|v| self.positions[v as usize]);
                let normal = (pb - pa).cross(pc - pa);
                let n = (pb - pa).cross(normal).normalize_or_zero();
                let quadric = Quadric::plane(n, -n.dot(pa), BOUNDARY_WEIGHT * weight);
                self.add_quadric(a, &quadric);
                self.add_quadric(b, &quadric);
            }
        }
    }

    fn fill_queue(&mut self, precision: Precision) {
        let faces: Vec<u32> = self.live().collect();
        let this = &*self;
        let entries: Vec<Entry> = faces
            .par_iter()
            .with_min_len(1024)
            .flat_map_iter(|&f| {
                let face = this.faces[f as usize].vertices;
                // The other face of an inner edge sees it the other way round.
                let edges = (0..3).map(move |k| (face[k], face[(k + 1) % 3]));
                let once = edges.filter(|&(u, v)| u < v || this.is_boundary_edge(u, v));
                once.map(|(u, v)| this.entry(u, v))
            })
            .collect();
        self.queue = Queue::new(precision);
        for entry in entries {
            self.queue.push(entry.cost, entry);
        }
    }

    fn entry(&self, u: u32, v: u32) -> Entry {
        let (u, v) = (u.min(v), u.max(v));
        Entry { cost: self.placement(u, v).1 as f32, u, v, stamp: self.stamp(u, v), refused: 0 }
    }

    fn stamp(&self, u: u32, v: u32) -> u32 {
        self.stamps[u as usize].wrapping_add(self.stamps[v as usize])
    }

    fn collapse_to(&mut self, target: usize, rules: Rules) {
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
            let place = self.place_of(&entry);
            if self.keeps_faces(u, v, place, rules.max_turn)
                && self.keeps_faces(v, u, place, rules.max_turn)
                && (rules.may_intersect || !self.intersects_more(u, v, place))
            {
                self.collapse(u, v, place);
            } else {
                self.push_next_place(&entry);
            }
        }
    }

    fn collapse(&mut self, u: u32, v: u32, place: DVec3) {
        let (quadric, mass) = (self.quadric(v), self.mass[v as usize]);
        self.add_quadric(u, &quadric);
        self.mass[u as usize] += mass;
        if let Some(in_motion) = &mut self.in_motion {
            let t = part_of_way(self.positions[u as usize], self.positions[v as usize], place);
            in_motion.merge(u, v, t);
        }
        self.positions[u as usize] = place;
        let mut kept = std::mem::take(&mut self.kept);
        kept.clear();
        for (w, other) in [(u, v), (v, u)] {
            let mut cursor = self.first[w as usize];
            while cursor != NONE {
                let (f, k) = (cursor as usize / 3, cursor as usize % 3);
                if self.faces[f].vertices[0] == NONE {
                } else if self.faces[f].vertices.contains(&other) {
                    self.kill(f as u32);
                } else {
                    self.faces[f].vertices[k] = u;
                    kept.push(cursor);
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
        self.first[v as usize] = NONE;
        // What is left of `v` in the queue is out of date too.
        self.stamps[u as usize] += 1;
        self.stamps[v as usize] += 1;
        if self.boundary[u as usize] || self.boundary[v as usize] {
            self.find_boundary_around(u);
        }
        self.push_edges_around(u);
    }

    /// Takes a face out of the mesh; returns the corners it had.
    fn kill(&mut self, f: u32) -> [u32; 3] {
        self.live_faces -= 1;
        if let Some(tree) = &mut self.tree {
            tree.remove(f);
        }
        std::mem::replace(&mut self.faces[f as usize].vertices, [NONE; 3])
    }

    fn push_edges_around(&mut self, u: u32) {
        self.mark += 1;
        let mut cursor = self.first[u as usize];
        while cursor != NONE {
            // What was linked anew is alive.
            for w in self.faces[cursor as usize / 3].vertices {
                if w != u && self.marks[w as usize] != self.mark {
                    self.marks[w as usize] = self.mark;
                    let entry = self.entry(u, w);
                    self.queue.push(entry.cost, entry);
                }
            }
            cursor = self.after(cursor);
        }
    }
}
