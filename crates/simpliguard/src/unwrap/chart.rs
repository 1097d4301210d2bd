//! One connected set of faces as a small mesh of its own.

use glam::DVec2;

use super::surface::{NONE, Surface};
use crate::geometry::DisjointSets;

/// Faces glued along every edge that they share and that is not cut. A vertex of the mesh where the chart is pinched becomes
/// several vertices, so a chart is always a manifold with boundary.
pub(super) struct Chart {
    /// Faces of the surface in rising order.
    pub faces: Vec<u32>,
    /// Vertices of each face, numbered within the chart.
    pub corners: Vec<[u32; 3]>,
    /// Number of vertices.
    pub vertices: usize,
    /// The boundary, counter-clockwise, if the chart is a disc.
    pub boundary: Option<Vec<u32>>,
    /// Half-edges along which the chart is cut though it has both their sides, in rising order.
    pub cuts: Vec<u32>,
}

/// A chart laid flat without overlap.
pub(super) struct FlatChart {
    pub chart: Chart,
    /// Position of each vertex; the area of the chart is that of its faces on the surface.
    pub uv: Vec<DVec2>,
}

impl Chart {
    /// `faces` must be connected, without repetition and in rising order.
    pub(super) fn new(surface: &Surface, faces: Vec<u32>) -> Self {
        Self::with_cuts(surface, faces, Vec::new())
    }

    /// As [`Self::new`], cut along these half-edges; they come in pairs and in rising order.
    pub(super) fn with_cuts(surface: &Surface, faces: Vec<u32>, cuts: Vec<u32>) -> Self {
        let mut sets = DisjointSets::new(3 * faces.len());
        let mut open = Vec::new();
        for (i, &f) in faces.iter().enumerate() {
            for k in 0..3 {
                match across(surface, &faces, &cuts, 3 * f + k as u32) {
                    Some((j, other)) => {
                        let m = other as usize % 3;
                        sets.join(3 * i + k, 3 * j + (m + 1) % 3);
                        sets.join(3 * i + (k + 1) % 3, 3 * j + m);
                    }
                    None => open.push((3 * i + k, 3 * i + (k + 1) % 3)),
                }
            }
        }
        let mut number = vec![u32::MAX; 3 * faces.len()];
        let mut vertices = 0;
        let mut corners = vec![[0; 3]; faces.len()];
        for c in 0..3 * faces.len() {
            let root = sets.find(c);
            if number[root] == u32::MAX {
                number[root] = vertices;
                vertices += 1;
            }
            corners[c / 3][c % 3] = number[root];
        }
        let edges = (3 * faces.len() + open.len()) / 2;
        let is_disc = vertices as usize + faces.len() == edges + 1;
        let open: Vec<(u32, u32)> =
            open.into_iter().map(|(a, b)| (corners[a / 3][a % 3], corners[b / 3][b % 3])).collect();
        let boundary = is_disc.then(|| walk(&open, vertices as usize)).flatten();
        Self { faces, corners, vertices: vertices as usize, boundary, cuts }
    }

    /// Whether a half-edge of the chart is on its border.
    pub(super) fn is_open(&self, surface: &Surface, half_edge: u32) -> bool {
        across(surface, &self.faces, &self.cuts, half_edge).is_none()
    }

    /// Corners of face `i` of the chart at the vertex positions `uv`.
    pub(super) fn triangle(&self, uv: &[DVec2], i: usize) -> [DVec2; 3] {
        self.corners[i].map(|v| uv[v as usize])
    }
}

/// The half-edge behind another, with the index of its face among `faces`, unless the chart ends or is cut there.
fn across(surface: &Surface, faces: &[u32], cuts: &[u32], half_edge: u32) -> Option<(usize, u32)> {
    let other = surface.opposite[half_edge as usize];
    let inside = other != NONE && cuts.binary_search(&half_edge).is_err();
    faces.binary_search(&(other / 3)).ok().filter(|_| inside).map(|j| (j, other))
}

/// The single loop through all open edges, or `None` if there are several.
fn walk(open: &[(u32, u32)], vertices: usize) -> Option<Vec<u32>> {
    let mut next = vec![u32::MAX; vertices];
    for &(a, b) in open {
        next[a as usize] = b;
    }
    let start = open.first()?.0;
    let mut out = vec![start];
    let mut v = next[start as usize];
    while v != start && out.len() <= open.len() {
        out.push(v);
        v = *next.get(v as usize)?;
    }
    (out.len() == open.len()).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{cube, tetrahedron};
    use super::*;

    #[test]
    fn three_sides_of_a_tetrahedron_are_a_disc_and_four_are_not() {
        let surface = Surface::new(&tetrahedron(), None);
        let cap = Chart::new(&surface, vec![0, 1, 2]);
        assert_eq!((cap.vertices, cap.boundary.map(|b| b.len())), (4, Some(3)));
        assert!(Chart::new(&surface, vec![0, 1, 2, 3]).boundary.is_none());
    }

    #[test]
    fn the_belt_of_a_cube_is_no_disc() {
        let surface = Surface::new(&cube(), None);
        assert!(Chart::new(&surface, (4..12).collect()).boundary.is_none());
        assert!(Chart::new(&surface, (4..10).collect()).boundary.is_some());
    }
}
