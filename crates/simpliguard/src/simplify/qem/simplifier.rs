//! The mesh that is simplified, and the state of its simplification.

use glam::{DVec3, Vec3};

use super::posed_quadrics::PosedQuadrics;
use super::quadric::{Attribute, Planes};
use super::queue::{Precision, Queue};
use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::FaceTree;

/// The end of a corner list.
pub(super) const NO_CORNER: u32 = u32::MAX;
/// The first vertex of a removed face.
const REMOVED: u32 = u32::MAX;
/// Sum of angles at which the curvature of a vertex is a half by default, in radians: all but flats have next to none, as
/// in the printed form.
const SMALLEST_ANGLE: f64 = 1e-3;

/// A mesh on its way down to a budget.
#[derive(Clone)]
pub(crate) struct Simplifier {
    pub(super) positions: Vec<DVec3>,
    /// Quadrics of the distance to planes, for each vertex.
    pub(super) planes: Vec<Planes>,
    /// Quadrics of the curvature, for each vertex; empty if the curvature has no weight.
    pub(super) attributes: Vec<Attribute>,
    /// Weight of the faces that have collapsed into each vertex.
    pub(super) mass: Vec<f64>,
    pub(super) faces: Vec<Face>,
    pub(super) live_faces: usize,
    /// First corner (`3 * face + k`) of each vertex, or [`NO_CORNER`].
    pub(super) first: Vec<u32>,
    /// For each vertex, true if it lies on the boundary.
    pub(super) boundary: Vec<bool>,
    /// Raised whenever a vertex changes. An entry of the queue with another sum of stamps is out of date.
    pub(super) stamps: Vec<u32>,
    pub(super) queue: Queue<QueuedCollapse>,
    /// Quadrics in other poses, once they are followed.
    pub(super) posed: Option<PosedQuadrics>,
    /// Boxes of the faces, once self-intersections are watched.
    pub(super) tree: Option<FaceTree>,
    /// True once a budget was met only by collapses that add self-intersections.
    pub(super) is_stuck: bool,
    /// True if the last budget was met only by collapses that flip faces, or by the removal of components.
    pub(super) is_exhausted: bool,
    /// Scratch for the link condition: the last mark of each vertex.
    pub(super) marks: Vec<u32>,
    /// The largest mark so far.
    pub(super) mark: u32,
    /// Scratch for a collapse: the corners that stay.
    pub(super) kept: Vec<u32>,
    pub(super) cancellation: Cancellation,
}

/// A face of the mesh, live or removed.
#[derive(Clone, Copy)]
pub(super) struct Face {
    pub(super) vertices: [u32; 3],
    /// For each corner, the next corner in the list of its vertex, or [`NO_CORNER`]. The lists may hold corners of
    /// removed faces, which are skipped.
    pub(super) next: [u32; 3],
}

impl Face {
    pub(super) fn is_live(&self) -> bool {
        self.vertices[0] != REMOVED
    }

    /// Removes the face; returns its vertices.
    pub(super) fn remove(&mut self) -> [u32; 3] {
        std::mem::replace(&mut self.vertices, [REMOVED; 3])
    }
}

/// A possible collapse of an edge, as the queue holds it.
#[derive(Clone, Copy)]
pub(super) struct QueuedCollapse {
    pub(super) cost: f32,
    pub(super) u: u32,
    pub(super) v: u32,
    /// Sum of both stamps when the entry was made. Stamps only rise, so an equal sum means that neither vertex has
    /// changed.
    pub(super) stamp: u32,
    /// Number of positions that were refused.
    pub(super) refused: u32,
}

impl Simplifier {
    /// A simplifier of a manifold mesh, with or without boundary. `weights` multiply the quadric of each face in place
    /// of its area; `curvature` is the weight of the curvature constraint. The mesh should fit the unit sphere.
    pub(crate) fn new(mesh: &TriMesh, weights: &[f64], curvature: f64) -> Self {
        Self::with_curvature(mesh, weights, curvature, SMALLEST_ANGLE)
    }

    /// As [`Self::new`], with the sum of angles around a vertex at which its curvature is a half, in radians.
    pub(crate) fn with_curvature(mesh: &TriMesh, weights: &[f64], curvature: f64, angle: f64) -> Self {
        let vertices = mesh.positions.len();
        let mut out = Self {
            positions: mesh.positions.iter().map(|p| p.as_dvec3()).collect(),
            planes: vec![Planes::default(); vertices],
            attributes: vec![Attribute::default(); if curvature > 0.0 { vertices } else { 0 }],
            mass: vec![0.0; vertices],
            live_faces: mesh.triangles.len(),
            faces: mesh.triangles.iter().map(|&vertices| Face { vertices, next: [NO_CORNER; 3] }).collect(),
            first: vec![NO_CORNER; vertices],
            boundary: Vec::new(),
            stamps: vec![0; vertices],
            queue: Queue::new(Precision::Coarse),
            posed: None,
            tree: None,
            is_stuck: false,
            is_exhausted: false,
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
        out.add_face_quadrics(weights, curvature, angle);
        out.add_boundary_quadrics(weights);
        out
    }

    /// Stops collapsing once `cancellation` is set.
    pub(crate) fn stop_with(&mut self, cancellation: &Cancellation) {
        self.cancellation = cancellation.clone();
    }

    /// The present number of faces.
    pub(crate) fn faces(&self) -> usize {
        self.live_faces
    }

    /// True if a budget was met only by collapses that add self-intersections.
    pub(crate) fn is_stuck(&self) -> bool {
        self.is_stuck
    }

    /// True if the last budget was met only by collapses that flip faces, or by the removal of components.
    pub(crate) fn is_exhausted(&self) -> bool {
        self.is_exhausted
    }

    /// The present mesh.
    pub(crate) fn mesh(&self) -> TriMesh {
        let all = TriMesh {
            positions: self.positions.iter().map(|p| p.as_vec3()).collect::<Vec<Vec3>>(),
            triangles: self.live().map(|f| self.face(f)).collect(),
        };
        all.filtered(|_| true)
    }
}
