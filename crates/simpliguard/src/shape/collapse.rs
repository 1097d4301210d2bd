//! Edge collapse by quadric error, on a mesh that stays a manifold.
//!
//! An edge may collapse if the link condition holds (Dey et al. 1999), no face turns over and none loses its area. When
//! no such edge is left the turn-over test is dropped, and last the smallest components go: a budget is only missed if
//! one component has too many handles.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::quadric::Quadric;
use crate::mesh::{DisjointSets, TriMesh};

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

    /// Removes components whose share of the mass is worth less than `faces` of `target`; together at most a fiftieth.
    pub(super) fn drop_negligible_components(&mut self, target: usize, faces: f64) {
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
    pub(super) fn remove_faces(&mut self, unseen: &[bool]) {
        let live: Vec<u32> = self.live().collect();
        let dead: Vec<u32> = live.iter().zip(unseen).filter(|(_, dead)| **dead).map(|(&f, _)| f).collect();
        self.remove(&dead);
        self.split_pinched_vertices();
        self.fill_heap();
    }

    /// The mesh as it stands.
    pub(super) fn mesh(&self) -> TriMesh {
        let all = TriMesh {
            positions: self.positions.iter().map(|p| p.as_vec3()).collect::<Vec<Vec3>>(),
            triangles: self.live().map(|f| self.faces[f as usize]).collect(),
        };
        all.filtered(|_| true)
    }

    fn live(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.faces.len() as u32).filter(|&f| self.faces[f as usize][0] != NONE)
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
        if let Some(p) = quadric.minimum()
            && p.distance(middle) < 2.0 * length
        {
            return (p, quadric.error(p) + tie);
        }
        let candidates = [middle, a, b].map(|p| (p, quadric.error(p)));
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

    /// A component that is down to a tetrahedron vanishes as a whole, at the error of its collapse to a point.
    fn collapse_tetrahedron(&mut self, entry: &Entry) {
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
                for v in self.faces[f as usize] {
                    if !vertices.contains(&v) {
                        vertices.push(v);
                    }
                }
            }
            at += 1;
        }
        let mut quadric = Quadric::default();
        vertices.iter().for_each(|&v| quadric.add(&self.quadrics[v as usize]));
        let middle = vertices.iter().map(|&v| self.positions[v as usize]).sum::<DVec3>() / vertices.len() as f64;
        let cost = (quadric.error(middle) as f32).to_bits();
        if entry.cost >= cost {
            self.remove(&faces);
        } else {
            self.heap.push(Reverse(Entry { cost, ..*entry }));
        }
    }

    /// Whether the mesh stays a manifold of the same topology, save that a hole of three edges closes.
    fn link_condition(&mut self, u: u32, v: u32) -> bool {
        let edge_faces = self.faces_of_edge(u, v);
        if edge_faces == 0 || edge_faces > 2 {
            return false;
        }
        if edge_faces == 2 && self.is_boundary(u) && self.is_boundary(v) {
            return false;
        }
        // Common neighbours must be the corners opposite to the edge, and not be joined on both sides.
        self.mark += 2;
        let (seen, shared) = (self.mark - 1, self.mark);
        self.mark_neighbours(u, v, seen);
        let (mut common, mut closing) = (0, 0);
        let (mut cursor, mut blocked) = (self.first[v as usize], false);
        while cursor != NONE {
            let face = self.faces[cursor as usize / 3];
            if face[0] != NONE {
                for w in face {
                    if w != u && w != v && self.marks[w as usize] == seen {
                        self.marks[w as usize] = shared;
                        common += 1;
                        let hole = edge_faces == 1
                            && !self.faces_of_edge_hold(u, v, w)
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
            cursor = self.next[cursor as usize];
        }
        common == edge_faces + closing.min(1) && !blocked
    }

    /// Whether some face has all three corners.
    fn faces_of_edge_hold(&self, u: u32, v: u32, w: u32) -> bool {
        self.faces_of(u).any(|(f, _)| {
            let face = self.faces[f as usize];
            face.contains(&v) && face.contains(&w)
        })
    }

    /// Whether `u` has a face with the corners of `face` other than `v`.
    fn has_face_with(&self, u: u32, face: [u32; 3], v: u32) -> bool {
        self.faces_of(u).any(|(f, _)| face.iter().all(|w| *w == v || self.faces[f as usize].contains(w)))
    }

    fn mark_neighbours(&mut self, u: u32, except: u32, mark: u32) {
        let mut cursor = self.first[u as usize];
        while cursor != NONE {
            let face = self.faces[cursor as usize / 3];
            if face[0] != NONE {
                for w in face {
                    if w != u && w != except {
                        self.marks[w as usize] = mark;
                    }
                }
            }
            cursor = self.next[cursor as usize];
        }
    }

    /// Whether the faces of `moved` that `other` is not part of stay the right way up when it moves to `place`.
    fn keeps_faces(&self, moved: u32, other: u32, place: DVec3, max_turn: f64) -> bool {
        self.faces_of(moved).all(|(f, k)| {
            let face = self.faces[f as usize];
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

    fn collapse(&mut self, u: u32, v: u32, place: DVec3) {
        let (quadric, mass) = (self.quadrics[v as usize], self.mass[v as usize]);
        self.quadrics[u as usize].add(&quadric);
        self.mass[u as usize] += mass;
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

    fn relink(&mut self, u: u32, corners: &[u32]) {
        self.first[u as usize] = corners.first().copied().unwrap_or(NONE);
        for (i, &corner) in corners.iter().enumerate() {
            self.next[corner as usize] = corners.get(i + 1).copied().unwrap_or(NONE);
        }
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

    fn corners_of(&self, v: u32) -> Vec<u32> {
        self.faces_of(v).map(|(f, k)| 3 * f + k as u32).collect()
    }

    /// Live faces of a vertex, and which of their corners it is.
    fn faces_of(&self, v: u32) -> impl Iterator<Item = (u32, usize)> + '_ {
        let mut cursor = self.first[v as usize];
        std::iter::from_fn(move || {
            while cursor != NONE {
                let corner = cursor;
                cursor = self.next[corner as usize];
                if self.faces[corner as usize / 3][0] != NONE {
                    return Some((corner / 3, corner as usize % 3));
                }
            }
            None
        })
    }

    fn faces_of_edge(&self, u: u32, v: u32) -> usize {
        self.faces_of(u).filter(|(f, _)| self.faces[*f as usize].contains(&v)).count()
    }

    fn is_boundary(&self, v: u32) -> bool {
        // In a closed fan each neighbour occurs in two faces.
        self.faces_of(v).any(|(f, k)| {
            let face = self.faces[f as usize];
            self.faces_of_edge(v, face[(k + 1) % 3]) == 1 || self.faces_of_edge(v, face[(k + 2) % 3]) == 1
        })
    }

    fn remove(&mut self, faces: &[u32]) {
        for &f in faces {
            for v in std::mem::replace(&mut self.faces[f as usize], [NONE; 3]) {
                self.stamps[v as usize] += 1;
            }
            self.live_faces -= 1;
        }
    }

    fn drop_smallest_components(&mut self, target: usize) {
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
    fn components(&self) -> Vec<Component> {
        let mut sets = DisjointSets::new(self.positions.len());
        for f in self.live() {
            let [a, b, c] = self.faces[f as usize];
            sets.join(a as usize, b as usize);
            sets.join(b as usize, c as usize);
        }
        let mut by_root: BTreeMap<usize, Component> = BTreeMap::new();
        for f in self.live() {
            let root = sets.find(self.faces[f as usize][0] as usize);
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

    /// Gives each fan of a vertex that a removal has pinched a vertex of its own.
    fn split_pinched_vertices(&mut self) {
        for v in 0..self.first.len() as u32 {
            let corners = self.corners_of(v);
            let mut sets = DisjointSets::new(corners.len());
            for i in 0..corners.len() {
                for j in i + 1..corners.len() {
                    let (a, b) = (self.faces[corners[i] as usize / 3], self.faces[corners[j] as usize / 3]);
                    if a.iter().filter(|w| b.contains(w)).count() >= 2 {
                        sets.join(i, j);
                    }
                }
            }
            let roots: Vec<usize> = (0..corners.len()).filter(|&i| sets.find(i) == i).collect();
            for (n, &root) in roots.iter().enumerate() {
                let fan: Vec<u32> = (0..corners.len()).filter(|&i| sets.find(i) == root).map(|i| corners[i]).collect();
                if n == 0 {
                    self.relink(v, &fan);
                } else {
                    self.add_copy(v, &fan);
                }
            }
            self.stamps[v as usize] += 1;
        }
    }

    fn add_copy(&mut self, v: u32, fan: &[u32]) {
        let copy = self.positions.len() as u32;
        self.positions.push(self.positions[v as usize]);
        self.quadrics.push(self.quadrics[v as usize]);
        self.mass.push(0.0);
        self.first.push(NONE);
        self.stamps.push(0);
        self.marks.push(0);
        for &corner in fan {
            self.faces[corner as usize / 3][corner as usize % 3] = copy;
        }
        self.relink(copy, fan);
    }
}

/// A component: its live faces and the mass of its vertices.
#[derive(Default)]
struct Component {
    faces: Vec<u32>,
    mass: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use proptest::prelude::*;

    fn grid(n: u32, height: impl Fn(f32, f32) -> f32) -> TriMesh {
        let at = |i: u32| i as f32 / n as f32;
        let positions = (0..(n + 1) * (n + 1))
            .map(|i| (at(i % (n + 1)), at(i / (n + 1))))
            .map(|(x, y)| Vec3::new(x, y, height(x, y)))
            .collect();
        let triangles = (0..n * n)
            .flat_map(|i| {
                let a = i / n * (n + 1) + i % n;
                [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
            })
            .collect();
        TriMesh { positions, triangles }
    }

    fn areas(mesh: &TriMesh) -> Vec<f64> {
        (0..mesh.triangles.len()).map(|t| f64::from(mesh.area_vector(t).length()) * 0.5).collect()
    }

    fn simplified(mesh: &TriMesh, target: usize) -> TriMesh {
        let mut simplifier = Simplifier::new(mesh, &areas(mesh), 0.0);
        simplifier.run(target);
        simplifier.mesh()
    }

    #[test]
    fn a_flat_square_collapses_to_two_faces_with_its_corners_in_place() {
        let out = simplified(&grid(8, |_, _| 0.0), 2);
        assert_eq!(out.triangles.len(), 2);
        let area: f32 = (0..2).map(|t| out.area_vector(t).length() * 0.5).sum();
        assert!((area - 1.0).abs() < 1e-5, "{area}");
    }

    #[test]
    fn a_crease_keeps_its_ridge() {
        let out = simplified(&grid(8, |x, _| if x < 0.5 { x } else { 1.0 - x }), 4);
        assert!(out.triangles.len() <= 4);
        assert!((out.bounds().1.z - 0.5).abs() < 1e-4, "{:?}", out.bounds());
    }

    #[test]
    fn a_tetrahedron_stays_within_its_budget_and_vanishes_below_it() {
        let mesh = TriMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        };
        assert_eq!(simplified(&mesh, 4).triangles.len(), 4);
        assert_eq!(simplified(&mesh, 3).triangles.len(), 0);
    }

    #[test]
    fn a_hole_of_three_edges_closes() {
        // An octahedron without one face.
        let mesh = TriMesh {
            positions: vec![Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z],
            triangles: vec![[2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
        };
        let out = simplified(&mesh, 6);
        let topology = Topology::of(&out);
        assert!(topology.is_manifold() && out.triangles.len() <= 6, "{topology:?}");
    }

    #[test]
    fn the_smallest_component_vanishes_first() {
        let mut mesh = TriMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        };
        let small: Vec<Vec3> = mesh.positions.iter().map(|p| *p * 0.1 + 3.0).collect();
        mesh.positions.extend(small);
        let copies: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| v + 4)).collect();
        mesh.triangles.extend(copies);
        let out = simplified(&mesh, 4);
        assert_eq!(out.triangles.len(), 4);
        assert!(out.bounds().1.max_element() < 2.0, "the large one stays");
    }

    #[test]
    fn removing_faces_leaves_no_pinched_vertex() {
        let mesh = grid(2, |_, _| 0.0);
        let mut simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.0);
        // Two opposite quadrants go: the centre would join the others at a point.
        simplifier.remove_faces(&[true, true, false, false, false, false, true, true]);
        let topology = Topology::of(&simplifier.mesh());
        assert_eq!((topology.non_manifold_vertices, topology.components), (0, 2));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn height_fields_stay_manifold_within_budget(
            heights in prop::collection::vec(-0.3f32..0.3, 121), target in 4usize..150,
        ) {
            let mesh = grid(10, |x, y| heights[((y * 10.0).round() * 11.0 + (x * 10.0).round()) as usize]);
            let out = simplified(&mesh, target);
            let topology = Topology::of(&out);
            prop_assert!(topology.is_manifold() && topology.degenerate == 0, "{:?}", topology);
            prop_assert!(out.triangles.len() <= target && out.triangles.len() + 2 >= target.min(200));
        }
    }
}
