//! Edge and vertex counts of a triangle mesh, and the checks every stage's output passes.

use super::DisjointSets;
use crate::data::TriMesh;

/// How often edges of each kind occur.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct EdgeCounts {
    /// Edges of one triangle.
    pub boundary: usize,
    /// Edges of more than two triangles, or of two that run along it in the same direction.
    pub non_manifold: usize,
    /// All edges.
    pub total: usize,
}

/// Topological figures of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Topology {
    /// Edges by kind.
    pub edges: EdgeCounts,
    /// Vertices whose triangles form more than one fan.
    pub non_manifold_vertices: usize,
    /// Triangles with a repeated vertex or without area.
    pub degenerate: usize,
    /// Vertices less edges plus faces.
    pub euler_characteristic: i64,
    /// Edge-connected components.
    pub components: usize,
}

impl Topology {
    /// Measures `mesh`.
    pub fn of(mesh: &TriMesh) -> Self {
        let mut half_edges = half_edges(mesh);
        half_edges.sort_unstable();
        let mut edges = EdgeCounts::default();
        let mut faces = DisjointSets::new(mesh.triangles.len());
        // Corners of one vertex joined over shared edges: more than one set left at a vertex is a pinch.
        let mut corners = DisjointSets::new(mesh.triangles.len() * 3);
        for run in half_edges.chunk_by(|a, b| a.edge == b.edge) {
            edges.total += 1;
            match run {
                [_] => edges.boundary += 1,
                [a, b] if a.forward != b.forward => {}
                _ => edges.non_manifold += 1,
            }
            for pair in run.windows(2) {
                faces.join(pair[0].face as usize, pair[1].face as usize);
                for end in [pair[0].edge.0, pair[0].edge.1] {
                    corners.join(corner(mesh, pair[0].face, end), corner(mesh, pair[1].face, end));
                }
            }
        }
        let used = used_vertices(mesh);
        let mut fans = vec![0u32; mesh.positions.len()];
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            for k in 0..3 {
                if corners.find(3 * t + k) == 3 * t + k {
                    fans[triangle[k] as usize] += 1;
                }
            }
        }
        Self {
            edges,
            non_manifold_vertices: fans.iter().filter(|&&n| n > 1).count(),
            degenerate: (0..mesh.triangles.len()).filter(|&t| is_degenerate(mesh, t)).count(),
            euler_characteristic: used as i64 - edges.total as i64 + mesh.triangles.len() as i64,
            components: (0..mesh.triangles.len()).filter(|&t| faces.find(t) == t).count(),
        }
    }

    /// Whether every edge has two triangles of opposite direction and every vertex one fan.
    pub fn is_closed_manifold(&self) -> bool {
        self.is_manifold() && self.edges.boundary == 0
    }

    /// Whether every edge has at most two triangles, of opposite direction, and every vertex one fan.
    pub fn is_manifold(&self) -> bool {
        self.edges.non_manifold == 0 && self.non_manifold_vertices == 0
    }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    edge: (u32, u32),
    face: u32,
    forward: bool,
}

fn half_edges(mesh: &TriMesh) -> Vec<HalfEdge> {
    let mut out = Vec::with_capacity(mesh.triangles.len() * 3);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            out.push(HalfEdge { edge: (a.min(b), a.max(b)), face: t as u32, forward: a < b });
        }
    }
    out
}

fn corner(mesh: &TriMesh, face: u32, vertex: u32) -> usize {
    let k = mesh.triangles[face as usize].iter().position(|&v| v == vertex).unwrap_or(0);
    3 * face as usize + k
}

fn used_vertices(mesh: &TriMesh) -> usize {
    let mut used = vec![false; mesh.positions.len()];
    for v in mesh.triangles.iter().flatten() {
        used[*v as usize] = true;
    }
    used.iter().filter(|&&u| u).count()
}

fn is_degenerate(mesh: &TriMesh, t: usize) -> bool {
    let [a, b, c] = mesh.triangles[t];
    a == b || b == c || c == a || mesh.area_vector(t).length_squared() == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn tetrahedron() -> TriMesh {
        TriMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        }
    }

    #[test]
    fn tetrahedron_is_a_closed_manifold_of_genus_zero() {
        let t = Topology::of(&tetrahedron());
        assert!(t.is_closed_manifold());
        assert_eq!((t.euler_characteristic, t.components, t.degenerate), (2, 1, 0));
    }

    #[test]
    fn a_missing_face_leaves_three_boundary_edges() {
        let mesh = tetrahedron().filtered(|t| t != 0);
        let t = Topology::of(&mesh);
        assert_eq!(t.edges, EdgeCounts { boundary: 3, non_manifold: 0, total: 6 });
        assert!(t.is_manifold() && !t.is_closed_manifold());
    }

    #[test]
    fn a_third_face_on_an_edge_is_non_manifold() {
        let mut mesh = tetrahedron();
        mesh.positions.push(Vec3::ONE);
        mesh.triangles.push([0, 1, 4]);
        assert_eq!(Topology::of(&mesh).edges.non_manifold, 1);
    }

    #[test]
    fn two_faces_that_run_the_same_way_are_non_manifold() {
        let mut mesh = tetrahedron();
        mesh.triangles[0].swap(0, 1);
        assert_eq!(Topology::of(&mesh).edges.non_manifold, 3);
    }

    #[test]
    fn two_tetrahedra_joined_at_a_vertex_pinch_it() {
        let mut mesh = tetrahedron();
        mesh.positions.extend([-Vec3::X, -Vec3::Y, -Vec3::Z]);
        mesh.triangles.extend([[0, 4, 5], [0, 6, 4], [0, 5, 6], [4, 6, 5]]);
        let t = Topology::of(&mesh);
        assert_eq!((t.edges.non_manifold, t.non_manifold_vertices, t.components), (0, 1, 2));
    }

    #[test]
    fn repeated_and_collinear_corners_are_degenerate() {
        let mesh =
            TriMesh { positions: vec![Vec3::ZERO, Vec3::X, 2.0 * Vec3::X], triangles: vec![[0, 0, 1], [0, 1, 2]] };
        assert_eq!(Topology::of(&mesh).degenerate, 2);
    }
}
