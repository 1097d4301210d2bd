//! The quadrics of the vertices before the first collapse.

use std::collections::HashSet;

use glam::DVec3;
use rayon::prelude::*;

use super::quadric::Quadric;
use super::simplifier::Simplifier;
use crate::geometry::{area_vector, face_components};

/// Weight of the planes that hold the boundary, relative to those of the faces beside it.
const BOUNDARY_WEIGHT: f64 = 3.0;
/// Width of the strip of surface that a boundary edge weighs at least as much as, for meshes in the unit sphere. A face of a
/// dense source is much narrower: by its own area alone, the boundary of a sheet would weigh nothing beside the sheet.
const BOUNDARY_STRIP: f64 = 0.03;
/// Largest part of a component's area that the strips along its boundary stand for.
const BOUNDARY_SHARE: f64 = 0.1;
/// Weight of the faces at the rim of removed faces, relative to that at a boundary of the source. Other parts hide the rim,
/// so it may move a little.
const RIM_WEIGHT: f64 = 0.2;

impl Simplifier {
    /// The quadric of a vertex.
    pub(super) fn quadric(&self, v: u32) -> Quadric {
        Quadric {
            planes: self.planes[v as usize],
            attribute: self.attributes.get(v as usize).copied().unwrap_or_default(),
        }
    }

    /// The sum of the quadrics of two vertices.
    pub(super) fn edge_quadric(&self, u: u32, v: u32) -> Quadric {
        let mut quadric = self.quadric(u);
        quadric.add(&self.quadric(v));
        quadric
    }

    pub(super) fn add_quadric(&mut self, v: u32, quadric: &Quadric) {
        self.planes[v as usize].add(&quadric.planes);
        if let Some(attribute) = self.attributes.get_mut(v as usize) {
            attribute.add(&quadric.attribute);
        }
    }

    /// Adds the planes of the faces, and their curvature if it has a weight.
    pub(super) fn add_face_quadrics(&mut self, weights: &[f64], curvature: f64, angle: f64) {
        let curvatures = if curvature > 0.0 { self.vertex_curvatures(angle) } else { Vec::new() };
        for (f, &weight) in (0u32..).zip(weights) {
            let (face, corners) = (self.face(f), self.corners(f));
            let n = area_vector(&corners).normalize_or_zero();
            let mut quadric = Quadric::plane(n, -n.dot(corners[0]), weight);
            if curvature > 0.0 {
                let c = face.map(|v| curvatures[v as usize]);
                quadric.add(&Quadric::curvature(corners, n, c, weight * curvature));
            }
            for v in face {
                self.add_quadric(v, &quadric);
                self.mass[v as usize] += weight;
            }
        }
    }

    /// The paper's curvature of each vertex, `1 / sum_j angle(n, N_j)`: low on ridges and creases, one on flats. The
    /// printed form is infinite on flats. Hence `half`, an angle, is added, and the result is scaled to at most one.
    fn vertex_curvatures(&self, half: f64) -> Vec<f64> {
        let normal = |f: u32| area_vector(&self.corners(f));
        (0..self.positions.len() as u32)
            .into_par_iter()
            .map(|v| {
                let mean = self.faces_of(v).map(|(f, _)| normal(f)).sum::<DVec3>().normalize_or_zero();
                let angles: f64 = self
                    .faces_of(v)
                    .map(|(f, _)| libm::acos(mean.dot(normal(f).normalize_or_zero()).clamp(-1.0, 1.0)))
                    .sum();
                half / (angles + half)
            })
            .collect()
    }

    /// Adds planes through the boundary edges, perpendicular to their faces. An edge weighs as much as its face, or as a strip
    /// of that face's density along the edge, whichever is more.
    pub(super) fn add_boundary_quadrics(&mut self, weights: &[f64]) {
        let edges = self.boundary_edges();
        let strips = self.boundary_strips(&edges);
        for (&(f, [a, b, c]), strip) in edges.iter().zip(strips) {
            let least = strip * self.length(a, b) / self.area(f).max(f64::MIN_POSITIVE);
            self.hold_edge([a, b, c], weights[f as usize] * least.max(1.0));
        }
    }

    /// The boundary edges: each face, its vertices in order, those of the edge first.
    pub(super) fn boundary_edges(&self) -> Vec<(u32, [u32; 3])> {
        let corners = |f: u32| (0..3).map(move |k| (f, [0, 1, 2].map(|i| self.face(f)[(k + i) % 3])));
        (0..self.faces.len() as u32).flat_map(corners).filter(|(_, [a, b, _])| self.is_boundary_edge(*a, *b)).collect()
    }

    /// The width of the strip that each boundary edge weighs at least as much as. All strips of a component together have at
    /// most a part of its area: otherwise ribbons and the ends of pipes would keep their boundary at the cost of the rest.
    pub(super) fn boundary_strips(&self, edges: &[(u32, [u32; 3])]) -> Vec<f64> {
        let triangles: Vec<[u32; 3]> = (0..self.faces.len() as u32).map(|f| self.face(f)).collect();
        let components = face_components(self.positions.len(), &triangles);
        let count = components.iter().max().map_or(0, |last| *last as usize + 1);
        let (mut areas, mut lengths) = (vec![0.0; count], vec![0.0; count]);
        components.iter().zip(0..).for_each(|(&c, f)| areas[c as usize] += self.area(f));
        let component = |f: u32| components[f as usize] as usize;
        edges.iter().for_each(|&(f, [a, b, _])| lengths[component(f)] += self.length(a, b));
        let strip = |f: u32| BOUNDARY_SHARE * areas[component(f)] / lengths[component(f)].max(f64::MIN_POSITIVE);
        edges.iter().map(|&(f, _)| strip(f).min(BOUNDARY_STRIP)).collect()
    }

    /// Adds planes through the edges that have become boundary because faces with the `removed` edges are gone. Without
    /// them, the rim of what is left would slide along the surface at no cost.
    pub(super) fn add_rim_quadrics(&mut self, removed: &HashSet<[u32; 2]>) {
        let density = self.weight_per_area();
        let live: Vec<u32> = self.live().collect();
        for f in live {
            let (face, area) = (self.face(f), self.area(f));
            let least = face.map(|v| density[v as usize]).into_iter().fold(f64::INFINITY, f64::min);
            for k in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|i| face[(k + i) % 3]);
                if removed.contains(&[b, a]) {
                    self.hold_edge([a, b, c], RIM_WEIGHT * least * area);
                }
            }
        }
    }

    /// Weight of the faces around each vertex, for each unit of their area.
    fn weight_per_area(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.positions.len()];
        for f in self.live() {
            self.face(f).into_iter().for_each(|v| areas[v as usize] += self.area(f));
        }
        self.mass.iter().zip(areas).map(|(mass, area)| mass / area.max(f64::MIN_POSITIVE)).collect()
    }

    fn length(&self, a: u32, b: u32) -> f64 {
        (self.positions[a as usize] - self.positions[b as usize]).length()
    }

    fn area(&self, f: u32) -> f64 {
        0.5 * area_vector(&self.corners(f)).length()
    }

    /// Adds the plane through edge `ab` of face `abc`, perpendicular to it.
    fn hold_edge(&mut self, [a, b, c]: [u32; 3], weight: f64) {
        let corners = [a, b, c].map(|v| self.positions[v as usize]);
        let [pa, pb, _] = corners;
        let n = (pb - pa).cross(area_vector(&corners)).normalize_or_zero();
        let quadric = Quadric::plane(n, -n.dot(pa), BOUNDARY_WEIGHT * weight);
        self.add_quadric(a, &quadric);
        self.add_quadric(b, &quadric);
    }
}
