//! Splits the faces of a level along the joint planes.

use std::collections::BTreeMap;

use glam::Vec3;

use super::joint_planes::JointPlane;
use crate::animation::{Skeleton, blended};
use crate::data::{Influences, Model, TriMesh};

/// A mesh, and the mesh from whose faces it was split.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplitMesh {
    /// The mesh after the split. The vertices before the split come first, unchanged.
    pub mesh: TriMesh,
    /// For each face, the face from which it was split, and the barycentric coordinates of its corners there.
    pub origins: Vec<(u32, [Vec3; 3])>,
    /// Influences of all vertices, interpolated along edges. Empty for a model without bones.
    pub influences: Vec<Influences>,
}

/// Splits the faces of `mesh` along the planes, one plane after another. A plane is left out if the mesh would get more
/// than `most` faces. `influences` are those of the vertices.
pub fn split_along(
    model: &Model,
    mesh: &TriMesh,
    influences: &[Influences],
    planes: &[JointPlane],
    most: usize,
) -> SplitMesh {
    let whole = [Vec3::X, Vec3::Y, Vec3::Z];
    let mut out = SplitMesh {
        mesh: mesh.clone(),
        origins: (0..mesh.triangles.len() as u32).map(|t| (t, whole)).collect(),
        influences: influences.to_vec(),
    };
    let Some(skeleton) = Skeleton::of(model).filter(|_| influences.len() == mesh.positions.len()) else { return out };
    for plane in planes {
        let cuts = out.cuts(&skeleton, plane);
        let added: usize =
            out.mesh.triangles.iter().map(|t| edges(t).filter(|edge| cuts.contains_key(edge)).count()).sum();
        if added > 0 && out.mesh.triangles.len() + added <= most {
            out.apply(&cuts);
        }
    }
    out
}

/// The edges of a face, each with its lower vertex first.
fn edges(triangle: &[u32; 3]) -> impl Iterator<Item = (u32, u32)> {
    let [a, b, c] = *triangle;
    [(a, b), (b, c), (c, a)].into_iter().map(|(a, b)| (a.min(b), a.max(b)))
}

impl SplitMesh {
    /// The edges that a plane splits, and the parameter of the split from the lower vertex to the higher.
    fn cuts(&self, skeleton: &Skeleton<'_>, plane: &JointPlane) -> BTreeMap<(u32, u32), f32> {
        let concerned: Vec<bool> = self.influences.iter().map(|i| plane.concerns(skeleton, i)).collect();
        let mut cuts = BTreeMap::new();
        for (a, b) in self.mesh.triangles.iter().flat_map(edges) {
            let [p, q] = [a, b].map(|v| self.mesh.positions[v as usize]);
            if concerned[a as usize]
                && concerned[b as usize]
                && let Some(t) = plane.crossing(p, q)
            {
                cuts.insert((a, b), t);
            }
        }
        cuts
    }

    /// Adds a vertex on each edge, and splits the faces at them.
    fn apply(&mut self, cuts: &BTreeMap<(u32, u32), f32>) {
        let mut added = BTreeMap::new();
        for (&(a, b), &t) in cuts {
            let [p, q] = [a, b].map(|v| self.mesh.positions[v as usize]);
            added.insert((a, b), (self.mesh.positions.len() as u32, t));
            self.mesh.positions.push(p.lerp(q, t));
            let blended = blended(&self.influences[a as usize], &self.influences[b as usize], t);
            self.influences.push(blended);
        }
        let triangles = std::mem::take(&mut self.mesh.triangles);
        for (triangle, (face, barycentric)) in triangles.into_iter().zip(std::mem::take(&mut self.origins)) {
            let corners = [0, 1, 2].map(|k| Corner { vertex: triangle[k], barycentric: barycentric[k] });
            let cuts = [0, 1, 2].map(|k| {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                let &(vertex, t) = added.get(&(a.vertex.min(b.vertex), a.vertex.max(b.vertex)))?;
                let t = if a.vertex < b.vertex { t } else { 1.0 - t };
                Some(Corner { vertex, barycentric: a.barycentric.lerp(b.barycentric, t) })
            });
            let positions = &self.mesh.positions;
            let distance = |a: Corner, b: Corner| positions[a.vertex as usize].distance(positions[b.vertex as usize]);
            for piece in split_face(corners, cuts, distance) {
                self.mesh.triangles.push(piece.map(|corner| corner.vertex));
                self.origins.push((face, piece.map(|corner| corner.barycentric)));
            }
        }
    }
}

/// A corner of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Corner {
    vertex: u32,
    /// Barycentric coordinates in the face before all splits.
    barycentric: Vec3,
}

/// The pieces of a face that is split at the vertices `cuts` on its edges. A quadrilateral that remains is divided
/// along its shorter diagonal.
fn split_face(
    [a, b, c]: [Corner; 3],
    cuts: [Option<Corner>; 3],
    distance: impl Fn(Corner, Corner) -> f32,
) -> Vec<[Corner; 3]> {
    match cuts {
        [None, None, None] => vec![[a, b, c]],
        [Some(ab), None, None] => vec![[a, ab, c], [ab, b, c]],
        [Some(ab), Some(bc), None] if distance(a, bc) < distance(ab, c) => {
            vec![[ab, b, bc], [a, ab, bc], [a, bc, c]]
        }
        [Some(ab), Some(bc), None] => vec![[ab, b, bc], [a, ab, c], [ab, bc, c]],
        [Some(ab), Some(bc), Some(ca)] => vec![[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]],
        // The corners rotate until an edge that is split comes first and one that is not comes last.
        [ab, bc, ca] => split_face([b, c, a], [bc, ca, ab], distance),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Topology;
    use crate::skinning::joint_planes::joint_planes;
    use crate::skinning::joint_planes::tests::tube;

    fn mesh(model: &Model) -> TriMesh {
        TriMesh { positions: model.surface.positions.clone(), triangles: model.surface.triangles.clone() }
    }

    #[test]
    fn a_limb_gets_a_closed_loop_of_vertices_on_the_plane() {
        let (planes, coarse) = (joint_planes(&tube(41), 0.15), tube(5));
        let before = mesh(&coarse);
        let split = split_along(&coarse, &before, &coarse.surface.influences, &planes, 100);
        // Four long edges and four diagonals of the eight faces between the second ring and the third are split.
        assert_eq!((split.mesh.positions.len(), split.mesh.triangles.len()), (20 + 8, 32 + 16));
        assert!(split.mesh.positions[20..].iter().all(|p| (p.x - 0.9).abs() < 1e-5));
        assert_eq!(split.mesh.positions[..20], before.positions);
        let topology = Topology::of(&split.mesh);
        assert_eq!((topology.edges.boundary, topology.edges.non_manifold, topology.degenerate), (8, 0, 0));
        for ((face, barycentric), triangle) in split.origins.iter().zip(&split.mesh.triangles) {
            let corners = before.corners(*face as usize);
            for (w, &v) in barycentric.iter().zip(triangle) {
                let p = corners[0] * w.x + corners[1] * w.y + corners[2] * w.z;
                assert!(p.distance(split.mesh.positions[v as usize]) < 1e-6);
            }
        }
        let area = |mesh: &TriMesh| (0..mesh.triangles.len()).map(|t| mesh.area_vector(t).length()).sum::<f32>();
        assert!((area(&split.mesh) - area(&before)).abs() < 1e-5);
    }

    #[test]
    fn a_plane_that_would_cost_too_many_faces_is_left_out() {
        let (planes, coarse) = (joint_planes(&tube(41), 0.15), tube(5));
        let split = split_along(&coarse, &mesh(&coarse), &coarse.surface.influences, &planes, 47);
        assert_eq!(split.mesh, mesh(&coarse));
    }

    #[test]
    fn what_hangs_on_other_bones_is_not_split() {
        let (planes, mut coarse) = (joint_planes(&tube(41), 0.15), tube(5));
        coarse.surface.influences.fill(Influences::rigid(2));
        let split = split_along(&coarse, &mesh(&coarse), &coarse.surface.influences, &planes, 100);
        assert_eq!(split.mesh, mesh(&coarse));
    }
}
