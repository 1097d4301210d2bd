//! A connected set of faces as a mesh of its own.

use glam::DVec2;

use super::half_edge_mesh::{HalfEdgeMesh, NO_NEIGHBOUR};
use crate::geometry::DisjointSets;

/// Faces joined along every edge that they share and that is not cut. A vertex of the mesh at which the chart is
/// pinched becomes several vertices, so a chart is always a manifold with boundary.
pub(super) struct Chart {
    /// Faces of the mesh in rising order.
    pub faces: Vec<u32>,
    /// Vertices of each face, numbered within the chart.
    pub corners: Vec<[u32; 3]>,
    /// Number of vertices.
    pub vertices: usize,
    /// The boundary, counter-clockwise, if the chart is a disc.
    pub boundary: Option<Vec<u32>>,
    /// Half-edges along which the chart is cut although it holds the faces of both sides, in rising order.
    pub cuts: Vec<u32>,
}

/// A chart laid flat without overlap.
pub(super) struct FlatChart {
    pub chart: Chart,
    /// Position of each vertex. The area of the flat chart is that of its faces on the surface.
    pub uv: Vec<DVec2>,
}

impl Chart {
    /// The chart of `faces`, which must be connected, without repetition and in rising order.
    pub(super) fn new(mesh: &HalfEdgeMesh, faces: Vec<u32>) -> Self {
        Self::with_cuts(mesh, faces, Vec::new())
    }

    /// As [`Self::new`], cut along these half-edges, which must come in pairs and in rising order.
    pub(super) fn with_cuts(mesh: &HalfEdgeMesh, faces: Vec<u32>, cuts: Vec<u32>) -> Self {
        let mut sets = DisjointSets::new(3 * faces.len());
        let mut open = Vec::new();
        for (i, &f) in faces.iter().enumerate() {
            for k in 0..3 {
                match across(mesh, &faces, &cuts, 3 * f + k as u32) {
                    Some((j, other)) => {
                        let m = other as usize % 3;
                        sets.join(3 * i + k, 3 * j + (m + 1) % 3);
                        sets.join(3 * i + (k + 1) % 3, 3 * j + m);
                    }
                    None => open.push((3 * i + k, 3 * i + (k + 1) % 3)),
                }
            }
        }
        let (vertex_of_corner, vertices) = sets.numbered();
        let corners: Vec<[u32; 3]> = vertex_of_corner.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        let edges = (3 * faces.len() + open.len()) / 2;
        // The Euler characteristic of a connected surface with boundary is one only for a disc.
        let is_disc = vertices + faces.len() == edges + 1;
        let open: Vec<(u32, u32)> = open.into_iter().map(|(a, b)| (vertex_of_corner[a], vertex_of_corner[b])).collect();
        let boundary = is_disc.then(|| single_loop(&open, vertices)).flatten();
        Self { faces, corners, vertices, boundary, cuts }
    }

    /// True if a half-edge of the chart lies on its boundary.
    pub(super) fn is_open(&self, mesh: &HalfEdgeMesh, half_edge: u32) -> bool {
        across(mesh, &self.faces, &self.cuts, half_edge).is_none()
    }

    /// The corners of face `i` of the chart, with the vertex positions `uv`.
    pub(super) fn triangle(&self, uv: &[DVec2], i: usize) -> [DVec2; 3] {
        self.corners[i].map(|v| uv[v as usize])
    }
}

/// The opposite half-edge and the index of its face among `faces`; `None` if the chart ends or is cut there.
fn across(mesh: &HalfEdgeMesh, faces: &[u32], cuts: &[u32], half_edge: u32) -> Option<(usize, u32)> {
    let other = mesh.opposite[half_edge as usize];
    let inside = other != NO_NEIGHBOUR && cuts.binary_search(&half_edge).is_err();
    faces.binary_search(&(other / 3)).ok().filter(|_| inside).map(|j| (j, other))
}

/// The loop through all open edges; `None` if they form several loops.
fn single_loop(open: &[(u32, u32)], vertices: usize) -> Option<Vec<u32>> {
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
        let mesh = HalfEdgeMesh::new(&tetrahedron(), None);
        let cap = Chart::new(&mesh, vec![0, 1, 2]);
        assert_eq!((cap.vertices, cap.boundary.map(|b| b.len())), (4, Some(3)));
        assert!(Chart::new(&mesh, vec![0, 1, 2, 3]).boundary.is_none());
    }

    #[test]
    fn the_belt_of_a_cube_is_no_disc() {
        let mesh = HalfEdgeMesh::new(&cube(), None);
        assert!(Chart::new(&mesh, (4..12).collect()).boundary.is_none());
        assert!(Chart::new(&mesh, (4..10).collect()).boundary.is_some());
    }
}
