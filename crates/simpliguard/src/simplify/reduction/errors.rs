//! The errors of the points and wedges before the first collapse.

use std::collections::HashMap;

use super::quadric::AttributeQuadric;
use super::reducer::Reducer;
use crate::geometry::area_vector;
use crate::simplify::qem::Quadric;

/// Weight of the planes that hold borders, relative to that of the faces beside them.
const BORDER_WEIGHT: f64 = 3.0;
/// The same for seams of attributes and of materials.
const SEAM_WEIGHT: f64 = 1.0;

impl Reducer<'_> {
    /// Adds the planes of the faces in every pose, and their attributes.
    pub(super) fn add_faces(&mut self, attribute_weights: &[f64]) {
        for f in self.mesh.live().collect::<Vec<_>>() {
            let (points, wedges) = (self.mesh.points(f), self.mesh.face(f));
            let weight = self.weights[f as usize];
            for pose in 0..self.poses.len() {
                let corners = points.map(|p| self.poses[pose][p as usize]);
                let n = area_vector(&corners).normalize_or_zero();
                let quadric = Quadric::plane(n, -n.dot(corners[0]), weight);
                points.into_iter().for_each(|p| self.shape_mut(p, pose).add(&quadric));
            }
            let corners = self.mesh.corners(f);
            let values = wedges.map(|w| &self.mesh.wedges[w as usize].values);
            let n = area_vector(&corners).normalize_or_zero();
            let quadric = AttributeQuadric::face(corners, n, values, attribute_weights[f as usize]);
            wedges.into_iter().for_each(|w| self.attributes[w as usize].add(&quadric));
        }
    }

    /// Adds planes through borders and seams, perpendicular to their faces, in every pose.
    pub(super) fn add_creases(&mut self) {
        let mut edges: HashMap<[u32; 2], Vec<(u32, [u32; 2])>> = HashMap::new();
        for f in self.mesh.live() {
            let (points, wedges) = (self.mesh.points(f), self.mesh.face(f));
            for k in 0..3 {
                let [(a, wa), (b, wb)] = [k, (k + 1) % 3].map(|k| (points[k], wedges[k]));
                let (edge, sides) = if a < b { ([a, b], [wa, wb]) } else { ([b, a], [wb, wa]) };
                edges.entry(edge).or_default().push((f, sides));
            }
        }
        // In the order of the edges: sums over floats do not depend on a hash.
        let mut edges: Vec<_> = edges.into_iter().collect();
        edges.sort_unstable_by_key(|(edge, _)| *edge);
        for ([a, b], faces) in edges {
            let weight = match &faces[..] {
                [(_, one), (_, other)] if one == other => continue,
                [_, _] => SEAM_WEIGHT,
                _ => BORDER_WEIGHT,
            };
            faces.into_iter().for_each(|(f, _)| self.hold_edge(a, b, f, weight));
        }
    }

    fn hold_edge(&mut self, a: u32, b: u32, f: u32, weight: f64) {
        let points = self.mesh.points(f);
        let weight = weight * self.weights[f as usize];
        for pose in 0..self.poses.len() {
            let [pa, pb] = [a, b].map(|p| self.poses[pose][p as usize]);
            let area = area_vector(&points.map(|p| self.poses[pose][p as usize]));
            let n = (pb - pa).cross(area).normalize_or_zero();
            let quadric = Quadric::plane(n, -n.dot(pa), weight);
            [a, b].into_iter().for_each(|p| self.shape_mut(p, pose).add(&quadric));
        }
    }
}
