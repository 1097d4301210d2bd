//! The mesh that is reduced: points in space, and the wedges of faces around them that share all attributes (Hoppe 1999).

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::attributes::{Scales, Values};
use crate::data::{self, Influences, Model, Surface};
use crate::geometry::{BoundingSphere, area_vector, face_components};
use crate::simplify::weld::places;

/// Least area of a face, doubled, in squared radii: less is no face for most tools.
pub(super) const LEAST_AREA: f64 = 2e-11;
/// Least cosine between the normals of a flat triangle and its own.
const FLAT: f32 = 0.9999;
/// The first wedge of a removed face.
const REMOVED: u32 = u32::MAX;

/// The corners of faces at one point that share all attributes and a material.
#[derive(Clone)]
pub(super) struct Wedge {
    pub(super) point: u32,
    pub(super) material: u32,
    pub(super) values: Values,
    /// The vertex of the source that it is, or comes from.
    pub(super) vertex: u32,
    /// Its attributes are its values, not those of its vertex.
    pub(super) is_new: bool,
    /// Its faces have normals of their own.
    pub(super) is_flat: bool,
}

/// A mesh of wedges.
#[derive(Clone)]
pub(super) struct WedgeMesh {
    pub(super) wedges: Vec<Wedge>,
    /// Wedges of each face.
    faces: Vec<[u32; 3]>,
    /// The triangle of the source that each face was.
    pub(super) source: Vec<u32>,
    live: usize,
    /// The live faces around each point.
    around: Vec<Vec<u32>>,
    /// Each point in the unit sphere.
    pub(super) positions: Vec<DVec3>,
    /// A vertex of the source at each point, or where it was.
    pub(super) vertices: Vec<u32>,
    /// Points that lie where the source may have no vertex.
    pub(super) is_moved: Vec<bool>,
}

impl WedgeMesh {
    /// The triangles of a model for which `keep` holds. Those without area are left out.
    pub(super) fn new(model: &Model, scales: &Scales<'_>, sphere: &BoundingSphere, keep: &[bool]) -> Self {
        let surface = &model.surface;
        let (point_of, vertices) = weld(&surface.positions, &surface.influences);
        let position = |&v: &u32| (surface.positions[v as usize] - sphere.centre).as_dvec3() / f64::from(sphere.radius);
        let positions: Vec<DVec3> = vertices.iter().map(position).collect();
        let (around, is_moved) = (vec![Vec::new(); positions.len()], vec![false; positions.len()]);
        let (wedges, faces, source) = (Vec::new(), Vec::new(), Vec::new());
        let mut mesh = Self { wedges, faces, source, live: 0, around, positions, vertices, is_moved };
        let flat = flat_triangles(surface, &point_of);
        let mut known = HashMap::new();
        for (t, triangle) in (0..).zip(&surface.triangles).filter(|(t, _)| keep[*t as usize]) {
            let points = triangle.map(|v| point_of[v as usize]);
            if area_vector(&points.map(|p| mesh.positions[p as usize])).length() < LEAST_AREA {
                continue;
            }
            let (material, is_flat) = (surface.material[t as usize], flat[t as usize]);
            let face = triangle.map(|vertex| {
                let (point, values) = (point_of[vertex as usize], scales.values(vertex, material, is_flat));
                *known
                    .entry((point, material, is_flat, values.map(f32::to_bits)))
                    .or_insert_with(|| mesh.push(Wedge { point, material, values, vertex, is_new: false, is_flat }))
            });
            points.iter().for_each(|&p| mesh.around[p as usize].push(mesh.faces.len() as u32));
            mesh.faces.push(face);
            mesh.source.push(t);
        }
        mesh.live = mesh.faces.len();
        mesh
    }

    /// Number of live faces.
    pub(super) fn face_count(&self) -> usize {
        self.live
    }

    /// The live faces.
    pub(super) fn live(&self) -> impl Iterator<Item = u32> {
        (0..self.faces.len() as u32).filter(|&f| self.faces[f as usize][0] != REMOVED)
    }

    /// The wedges of a face.
    pub(super) fn face(&self, f: u32) -> [u32; 3] {
        self.faces[f as usize]
    }

    /// The material of a face.
    pub(super) fn material(&self, f: u32) -> u32 {
        self.wedges[self.faces[f as usize][0] as usize].material
    }

    /// The points of a face.
    pub(super) fn points(&self, f: u32) -> [u32; 3] {
        self.faces[f as usize].map(|w| self.wedges[w as usize].point)
    }

    /// The corners of a face.
    pub(super) fn corners(&self, f: u32) -> [DVec3; 3] {
        self.points(f).map(|p| self.positions[p as usize])
    }

    /// The live faces around a point.
    pub(super) fn around(&self, point: u32) -> &[u32] {
        &self.around[point as usize]
    }

    /// The points that share a face with a point, ascending.
    pub(super) fn neighbours(&self, point: u32) -> Vec<u32> {
        let points = self.around(point).iter().flat_map(|&f| self.points(f));
        let mut out: Vec<u32> = points.filter(|&p| p != point).collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// The wedges of a face at two points, if it has both.
    pub(super) fn wedges_at(&self, f: u32, u: u32, v: u32) -> Option<[u32; 2]> {
        Some([self.wedge_at(f, u)?, self.wedge_at(f, v)?])
    }

    /// The wedges of the faces around a point, each once.
    pub(super) fn wedges_of(&self, point: u32) -> Vec<u32> {
        let mut out = Vec::new();
        for wedge in self.around(point).iter().filter_map(|&f| self.wedge_at(f, point)) {
            if !out.contains(&wedge) {
                out.push(wedge);
            }
        }
        out
    }

    /// Moves a point to a place in the unit sphere where the source may have no vertex.
    pub(super) fn place(&mut self, point: u32, place: DVec3) {
        self.positions[point as usize] = place;
        self.is_moved[point as usize] = true;
    }

    /// The wedge of a face at a point.
    pub(super) fn wedge_at(&self, f: u32, point: u32) -> Option<u32> {
        self.faces[f as usize].into_iter().find(|&w| self.wedges[w as usize].point == point)
    }

    /// Adds a wedge.
    pub(super) fn push(&mut self, wedge: Wedge) -> u32 {
        self.wedges.push(wedge);
        self.wedges.len() as u32 - 1
    }

    /// Removes the faces at the edge `u v` and moves the others of `u` to `v`, where `target` has the wedge that replaces each of
    /// theirs.
    pub(super) fn collapse(&mut self, u: u32, v: u32, target: impl Fn(u32) -> u32) {
        for f in std::mem::take(&mut self.around[u as usize]) {
            if self.points(f).contains(&v) {
                self.remove(f, Some(u));
                continue;
            }
            let wedges = &self.wedges;
            for w in self.faces[f as usize].iter_mut().filter(|w| wedges[**w as usize].point == u) {
                *w = target(*w);
            }
            self.around[v as usize].push(f);
        }
    }

    /// Removes a face from all lists but that of the point `but`.
    pub(super) fn remove(&mut self, f: u32, but: Option<u32>) {
        for p in self.points(f).into_iter().filter(|&p| Some(p) != but) {
            self.around[p as usize].retain(|&other| other != f);
        }
        self.faces[f as usize][0] = REMOVED;
        self.live -= 1;
    }
}

/// The triangles of connected parts that are flat-shaded: each normal is that of its triangle.
fn flat_triangles(surface: &Surface, point_of: &[u32]) -> Vec<bool> {
    let welded: Vec<[u32; 3]> = surface.triangles.iter().map(|t| t.map(|v| point_of[v as usize])).collect();
    let components = face_components(surface.positions.len(), &welded);
    let is_flat = |triangle: &[u32; 3]| {
        let area = data::area_vector(triangle.map(|v| surface.positions[v as usize]));
        let normal = area.normalize_or_zero();
        normal == Vec3::ZERO || triangle.iter().all(|&v| surface.normals[v as usize].dot(normal) > FLAT)
    };
    let mut bent = vec![false; surface.positions.len()];
    for (triangle, &component) in surface.triangles.iter().zip(&components) {
        bent[component as usize] |= !is_flat(triangle);
    }
    components.iter().map(|&component| !bent[component as usize]).collect()
}

/// The point of each vertex, and a vertex of each point. Vertices of one place that follow other bones are different points.
fn weld(positions: &[Vec3], influences: &[Influences]) -> (Vec<u32>, Vec<u32>) {
    let place = places(positions);
    let (mut known, mut vertices) = (HashMap::with_capacity(positions.len()), Vec::new());
    let mut point = |(v, p): (u32, &Vec3)| {
        let bones = influences.get(v as usize).map(|i| (i.joints, i.weights.map(f32::to_bits)));
        *known.entry((place(*p), bones)).or_insert_with(|| {
            vertices.push(v);
            vertices.len() as u32 - 1
        })
    };
    let points = (0..).zip(positions).map(&mut point).collect();
    (points, vertices)
}
