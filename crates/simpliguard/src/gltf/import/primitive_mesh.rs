//! The triangles of a primitive, and its vertices that are alike made one.

use glam::{Vec2, Vec3, Vec4};

use crate::data::{Influences, area_vector, gather};
use crate::geometry::first_equal;

/// Triangles and their vertices. Attributes that are present have the length of `positions`.
#[derive(Debug, Default)]
pub(super) struct PrimitiveMesh {
    /// Includes morph targets at their default weights.
    pub(super) positions: Vec<Vec3>,
    /// Unit length, or zero for a vertex without a triangle of positive area.
    pub(super) normals: Vec<Vec3>,
    pub(super) tangents: Option<Vec<Vec4>>,
    pub(super) uvs: [Option<Vec<Vec2>>; 2],
    pub(super) colors: Option<Vec<Vec4>>,
    /// Red of the second vertex colour.
    pub(super) painted: Option<Vec<f32>>,
    /// Joints as numbered by the skin; all zero for a vertex without positive weights.
    pub(super) influences: Option<Vec<Influences>>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Displacement of each vertex by each morph target. Empty for targets without positions, and if not asked for.
    pub(super) displacements: Vec<Vec<Vec3>>,
    /// Seen from both sides.
    pub(super) double_sided: bool,
}

impl PrimitiveMesh {
    /// Merges the vertices whose attributes are equal bit by bit. A primitive without indices lists each vertex once for every
    /// triangle around it, six times on average.
    pub(super) fn with_merged_vertices(self) -> Self {
        let mut triangles = self.triangles.clone();
        let first = first_equal_vertices(&self);
        triangles.iter_mut().flatten().for_each(|vertex| *vertex = first[*vertex as usize]);
        let kept = renumber(&mut triangles, self.positions.len());
        self.gathered(&kept, triangles)
    }

    /// Gives each triangle vertices of its own with its normal, as glTF asks of a mesh without normals.
    pub(super) fn with_flat_normals(self) -> Self {
        let corners: Vec<u32> = self.triangles.as_flattened().to_vec();
        let triangles = (0..self.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let normal = |triangle: &[u32; 3]| {
            let area = area_vector(triangle.map(|v| self.positions[v as usize]));
            [area.try_normalize().unwrap_or_default(); 3]
        };
        let normals = self.triangles.iter().flat_map(normal).collect();
        Self { normals, ..self.gathered(&corners, triangles) }.with_merged_vertices()
    }

    /// Weighed by area, the normals point away from the side that it is seen counter-clockwise from.
    pub(super) fn is_inverted(&self) -> bool {
        let along_normal = |t: &[u32; 3]| {
            let normal: Vec3 = t.map(|v| self.normals[v as usize]).into_iter().sum();
            let area = area_vector(t.map(|v| self.positions[v as usize]));
            area.dot(normal)
        };
        self.triangles.iter().map(along_normal).sum::<f32>() < 0.0
    }

    /// The vertices with the indices `kept` under other triangles.
    fn gathered(self, kept: &[u32], triangles: Vec<[u32; 3]>) -> Self {
        Self {
            positions: gather(&self.positions, kept),
            normals: gather(&self.normals, kept),
            tangents: self.tangents.map(|all| gather(&all, kept)),
            uvs: self.uvs.map(|uvs| uvs.map(|all| gather(&all, kept))),
            colors: self.colors.map(|all| gather(&all, kept)),
            painted: self.painted.map(|all| gather(&all, kept)),
            influences: self.influences.map(|all| gather(&all, kept)),
            displacements: self.displacements.into_iter().map(|all| gather(&all, kept)).collect(),
            double_sided: self.double_sided,
            triangles,
        }
    }
}

/// Renumbers the corners in order of first use and returns the old number of each vertex.
pub(super) fn renumber(triangles: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut used = Vec::new();
    // Zero means not seen yet. Zeroed memory that is never touched costs nothing, even for a large shared buffer.
    let mut new_number = vec![0u32; vertices];
    for vertex in triangles.iter_mut().flatten() {
        let slot = &mut new_number[*vertex as usize];
        if *slot == 0 {
            used.push(*vertex);
            *slot = used.len() as u32;
        }
        *vertex = *slot - 1;
    }
    used
}

/// The lowest vertex with equal attributes, for each vertex.
fn first_equal_vertices(mesh: &PrimitiveMesh) -> Vec<u32> {
    let mut words = Vec::new();
    let mut stride = 0;
    for vertex in 0..mesh.positions.len() {
        push_attributes(&mut words, mesh, vertex);
        if vertex == 0 {
            stride = words.len();
            words.reserve_exact(stride * (mesh.positions.len() - 1));
        }
    }
    first_equal(mesh.positions.len(), |vertex| &words[vertex * stride..][..stride])
}

/// Adds the bits of all attributes of a vertex.
fn push_attributes(words: &mut Vec<u32>, mesh: &PrimitiveMesh, vertex: usize) {
    let mut push = |values: &[f32]| words.extend(values.iter().map(|value| value.to_bits()));
    push(&mesh.positions[vertex].to_array());
    push(&mesh.normals[vertex].to_array());
    let pairs = mesh.uvs.iter().flatten().map(|all| all[vertex]);
    pairs.for_each(|uv: Vec2| push(&uv.to_array()));
    let fours = [&mesh.tangents, &mesh.colors].into_iter().flatten().map(|all| all[vertex]);
    fours.for_each(|value: Vec4| push(&value.to_array()));
    mesh.painted.iter().for_each(|all| push(&[all[vertex]]));
    let moved = mesh.displacements.iter().filter(|all| !all.is_empty()).map(|all| all[vertex]);
    moved.for_each(|offset: Vec3| push(&offset.to_array()));
    for Influences { joints, weights } in mesh.influences.iter().map(|all| all[vertex]) {
        words.extend(weights.map(f32::to_bits));
        words.extend(joints.map(u32::from));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of a square without indices, whose corner 3 differs from corner 0 in its texture coordinate.
    fn square() -> PrimitiveMesh {
        let [a, b, c, d] = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        let [left, right] = [Vec2::ZERO, Vec2::X];
        PrimitiveMesh {
            positions: vec![a, b, c, a, c, d],
            normals: vec![Vec3::Z; 6],
            uvs: [Some(vec![left, right, right, right, right, left]), None],
            displacements: vec![Vec::new(), vec![Vec3::Z; 6]],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            ..PrimitiveMesh::default()
        }
    }

    #[test]
    fn vertices_that_are_alike_become_one() {
        let merged = square().with_merged_vertices();
        assert_eq!(merged.triangles, [[0, 1, 2], [3, 2, 4]]);
        assert_eq!(merged.positions, [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::ZERO, Vec3::Y]);
        assert_eq!(merged.uvs[0].as_deref(), Some([0.0, 1.0, 1.0, 1.0, 0.0].map(|x| Vec2::X * x).as_slice()));
        assert_eq!(
            (merged.normals.len(), merged.displacements.iter().map(Vec::len).collect::<Vec<_>>()),
            (5, vec![0, 5])
        );
    }

    #[test]
    fn without_normals_faces_are_flat_and_share_vertices_where_they_are_even() {
        let mut folded = square();
        folded.uvs = [None, None];
        let even = folded.with_flat_normals();
        assert_eq!((even.positions.len(), even.normals.as_slice()), (4, [Vec3::Z; 4].as_slice()));
        let mut folded = square();
        folded.positions[5].z = 1.0;
        let folded = folded.with_flat_normals();
        assert_eq!(folded.positions.len(), 6);
        assert_eq!(folded.normals[..3], [Vec3::Z; 3]);
        assert!(folded.normals[3..].iter().all(|n| (*n - folded.normals[3]).length() == 0.0 && n.z < 0.9));
    }

    #[test]
    fn a_mesh_without_triangles_stays_empty() {
        assert!(PrimitiveMesh::default().with_merged_vertices().positions.is_empty());
    }
}
