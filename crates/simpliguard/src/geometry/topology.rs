//! Edge and vertex counts of a triangle mesh, and the check of a stage's output.

use super::connected_components::DisjointSets;
use super::half_edges::sorted_half_edges;
use crate::data::TriMesh;

/// Numbers of edges by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct EdgeCounts {
    /// Edges of one triangle.
    pub boundary: usize,
    /// Edges of more than two triangles, or of two that run along it in the same direction.
    pub non_manifold: usize,
    /// All edges.
    pub total: usize,
}

/// Topological counts of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Topology {
    /// Edges by kind.
    pub edges: EdgeCounts,
    /// Vertices whose triangles form more than one fan.
    pub non_manifold_vertices: usize,
    /// Triangles with a repeated vertex or without area.
    pub degenerate: usize,
    /// Used vertices minus edges plus faces.
    pub euler_characteristic: i64,
    /// Components of triangles that share edges.
    pub components: usize,
}

impl Topology {
    /// Measures `mesh`.
    pub fn of(mesh: &TriMesh) -> Self {
        let mut edges = EdgeCounts::default();
        let mut faces = DisjointSets::new(mesh.triangles.len());
        // Corners of one vertex, joined across shared edges: each set is a fan.
        let mut corners = DisjointSets::new(mesh.triangles.len() * 3);
        for run in sorted_half_edges(&mesh.triangles).chunk_by(|a, b| a.edge == b.edge) {
            edges.total += 1;
            match run {
                [_] => edges.boundary += 1,
                [a, b] if a.forward != b.forward => {}
                _ => edges.non_manifold += 1,
            }
            for pair in run.windows(2) {
                let [a, b] = [pair[0].face(), pair[1].face()];
                faces.join(a as usize, b as usize);
                for end in [pair[0].edge.0, pair[0].edge.1] {
                    corners.join(corner(mesh, a, end), corner(mesh, b, end));
                }
            }
        }
        Self {
            edges,
            non_manifold_vertices: fans(mesh, corners).into_iter().filter(|&n| n > 1).count(),
            degenerate: (0..mesh.triangles.len()).filter(|&t| is_degenerate(mesh, t)).count(),
            euler_characteristic: used_vertices(mesh) as i64 - edges.total as i64 + mesh.triangles.len() as i64,
            components: faces.numbered().1,
        }
    }

    /// True if every edge has two triangles of opposite direction and every vertex one fan.
    pub fn is_closed_manifold(&self) -> bool {
        self.is_manifold() && self.edges.boundary == 0
    }

    /// True if every edge has at most two triangles, of opposite direction, and every vertex one fan.
    pub fn is_manifold(&self) -> bool {
        self.edges.non_manifold == 0 && self.non_manifold_vertices == 0
    }

    /// Checks that `mesh` is a manifold with or without boundary, without degenerate faces.
    ///
    /// # Errors
    ///
    /// The defects and their numbers, such as "2 non-manifold edges, 1 pinched vertex": vertices that are not finite,
    /// faces with an index out of range, non-manifold edges, pinched vertices and degenerate faces. A mesh with an
    /// index out of range is not examined further.
    pub fn validate_manifold(mesh: &TriMesh) -> Result<(), String> {
        let is_outside = |t: &&[u32; 3]| t.iter().any(|&v| v as usize >= mesh.positions.len());
        let outside = mesh.triangles.iter().filter(is_outside).count();
        let topology = if outside == 0 { Self::of(mesh) } else { Self::default() };
        let defects = [
            (mesh.positions.iter().filter(|p| !p.is_finite()).count(), "non-finite vertex", "non-finite vertices"),
            (outside, "face with an index out of range", "faces with an index out of range"),
            (topology.edges.non_manifold, "non-manifold edge", "non-manifold edges"),
            (topology.non_manifold_vertices, "pinched vertex", "pinched vertices"),
            (topology.degenerate, "degenerate face", "degenerate faces"),
        ];
        let found = defects.into_iter().filter(|(count, ..)| *count > 0);
        let found: Vec<String> =
            found.map(|(count, one, many)| format!("{count} {}", if count == 1 { one } else { many })).collect();
        if found.is_empty() { Ok(()) } else { Err(found.join(", ")) }
    }
}

/// Number of fans of each vertex, given the sets of corners that shared edges join.
fn fans(mesh: &TriMesh, corners: DisjointSets) -> Vec<u32> {
    let mut fans = vec![0; mesh.positions.len()];
    for (corner, root) in corners.roots().into_iter().enumerate() {
        if root as usize == corner {
            fans[mesh.triangles[corner / 3][corner % 3] as usize] += 1;
        }
    }
    fans
}

/// Index `3 f + k` of the corner of a face at a vertex.
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

    #[test]
    fn a_mesh_with_or_without_boundary_is_valid() {
        for mesh in [TriMesh::default(), tetrahedron(), tetrahedron().filtered(|t| t != 0)] {
            assert_eq!(Topology::validate_manifold(&mesh), Ok(()));
        }
    }

    #[test]
    fn defects_are_counted_and_named() {
        let mut mesh = tetrahedron();
        mesh.positions.extend([-Vec3::X, -Vec3::Y, -Vec3::Z]);
        mesh.triangles.extend([[0, 4, 5], [0, 6, 4], [0, 5, 6], [4, 6, 5]]);
        assert_eq!(Topology::validate_manifold(&mesh), Err("1 pinched vertex".into()));
        mesh.triangles[0].swap(0, 1);
        let found = Topology::validate_manifold(&mesh);
        assert_eq!(found, Err("3 non-manifold edges, 1 pinched vertex".into()));
        mesh.triangles = vec![[0, 5, 6], [1, 2, 3]];
        mesh.positions[2] = 2.0 * Vec3::X;
        mesh.positions[3] = 3.0 * Vec3::X;
        mesh.positions[4].y = f32::NAN;
        let found = Topology::validate_manifold(&mesh);
        assert_eq!(found, Err("1 non-finite vertex, 1 degenerate face".into()));
        mesh.triangles[1][2] = 7;
        let found = Topology::validate_manifold(&mesh);
        assert_eq!(found, Err("1 non-finite vertex, 1 face with an index out of range".into()));
    }
}
