//! Joint planes (SimpliGuard, section 3.5): edge loops where limbs bend.
//!
//! Where the two largest weights of the source's vertices are about equal, two bones meet. Such vertices are grouped by
//! their two bones; the plane of a group goes through its centre, across the limb. Faces of a level that a plane crosses
//! are split along it, so that the level has vertices where the bend is.
//!
//! The paper finds the groups among the vertices of the low-poly mesh, of which few have weights that close; here the
//! source's own are taken, and all levels share the planes.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::animation::{Skeleton, blended};
use crate::data::{Influences, Model, TriMesh};

/// Edges are only split between these parts of their length, or slivers would result.
const INNER: std::ops::RangeInclusive<f32> = 0.15..=0.85;
/// How far a plane reaches, as a multiple of the mean distance of its vertices from its centre.
const REACH: f32 = 2.0;
/// Least part of a vertex's weight on the two bones of a plane that cuts beside it.
const ON_BONES: f32 = 0.5;
/// Fewest source vertices of a plane.
const FEWEST: usize = 3;

/// Where two bones meet.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPlane {
    /// Centre of the vertices between the bones, in the world.
    pub centre: Vec3,
    /// Across the limb; unit length.
    pub normal: Vec3,
    /// How far from the centre it cuts, in metres.
    pub reach: f32,
    /// The two joints, as numbered in [`Skeleton`], the lower first.
    pub joints: [usize; 2],
}

/// The planes of a model, the widest first: vertices whose two largest weights differ by less than `delta` lie on them.
/// None for a model without bones.
pub fn joint_planes(model: &Model, delta: f32) -> Vec<JointPlane> {
    let Some(joints) = Skeleton::of(model) else { return Vec::new() };
    let surface = &model.surface;
    let mut groups: BTreeMap<[usize; 2], Vec<Vec3>> = BTreeMap::new();
    for (position, influences) in surface.positions.iter().zip(&surface.influences) {
        let [first, second, ..] = influences.weights;
        if second > 0.0 && first - second < delta {
            let mut pair = [joints.of_bone(influences.joints[0]), joints.of_bone(influences.joints[1])];
            pair.sort_unstable();
            groups.entry(pair).or_default().push(*position);
        }
    }
    let mut planes: Vec<JointPlane> =
        groups.iter().filter_map(|(pair, positions)| JointPlane::through(&joints, *pair, positions)).collect();
    planes.sort_by(|a, b| b.reach.total_cmp(&a.reach));
    planes
}

impl JointPlane {
    fn through(joints: &Skeleton<'_>, pair: [usize; 2], positions: &[Vec3]) -> Option<Self> {
        let [a, b] = pair;
        let normal = match (joints.parent(a), joints.parent(b)) {
            _ if positions.len() < FEWEST || a == b => return None,
            (_, Some(above)) if above == a => joints.axis(b),
            (Some(above), _) if above == b => joints.axis(a),
            _ => (joints.place(b) - joints.place(a)).normalize_or_zero(),
        };
        let centre = positions.iter().sum::<Vec3>() / positions.len() as f32;
        let spread = positions.iter().map(|p| p.distance(centre)).sum::<f32>() / positions.len() as f32;
        (normal != Vec3::ZERO && spread > 0.0).then_some(Self { centre, normal, reach: REACH * spread, joints: pair })
    }

    /// Where the plane splits the edge from `a` to `b`, as a part of the way.
    fn crossing(&self, a: Vec3, b: Vec3) -> Option<f32> {
        let (from, to) = (self.normal.dot(a - self.centre), self.normal.dot(b - self.centre));
        let t = from / (from - to);
        let is_near = || a.lerp(b, t).distance(self.centre) <= self.reach;
        ((from < 0.0) != (to < 0.0) && INNER.contains(&t) && is_near()).then_some(t)
    }

    fn is_beside(&self, joints: &Skeleton<'_>, influences: &Influences) -> bool {
        let slots = influences.joints.iter().zip(influences.weights).filter(|(_, weight)| *weight > 0.0);
        let own = slots.filter(|(bone, _)| self.joints.contains(&joints.of_bone(**bone)));
        own.map(|(_, weight)| weight).sum::<f32>() >= ON_BONES
    }
}

/// A mesh whose faces are parts of another's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointSplit {
    /// The mesh. Vertices of the other come first and are the same.
    pub mesh: TriMesh,
    /// For each face the one it is a part of, and where its corners are there (barycentric coordinates).
    pub parts: Vec<(u32, [Vec3; 3])>,
    /// Influences of all vertices, interpolated along edges; those of a model without bones are empty.
    pub influences: Vec<Influences>,
}

/// Splits the faces of `mesh` along the planes, in their order, as long as it stays within `most` faces.
pub fn split_along(
    model: &Model,
    mesh: &TriMesh,
    influences: &[Influences],
    planes: &[JointPlane],
    most: usize,
) -> JointSplit {
    let whole = [Vec3::X, Vec3::Y, Vec3::Z];
    let mut out = JointSplit {
        mesh: mesh.clone(),
        parts: (0..mesh.triangles.len() as u32).map(|t| (t, whole)).collect(),
        influences: influences.to_vec(),
    };
    let Some(joints) = Skeleton::of(model).filter(|_| influences.len() == mesh.positions.len()) else { return out };
    for plane in planes {
        let cuts = out.cuts(&joints, plane);
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

impl JointSplit {
    /// The edges that a plane splits, and where.
    fn cuts(&self, joints: &Skeleton<'_>, plane: &JointPlane) -> BTreeMap<(u32, u32), f32> {
        let beside: Vec<bool> = self.influences.iter().map(|i| plane.is_beside(joints, i)).collect();
        let mut cuts = BTreeMap::new();
        for (a, b) in self.mesh.triangles.iter().flat_map(edges) {
            let [p, q] = [a, b].map(|v| self.mesh.positions[v as usize]);
            if beside[a as usize]
                && beside[b as usize]
                && let Some(t) = plane.crossing(p, q)
            {
                cuts.insert((a, b), t);
            }
        }
        cuts
    }

    fn apply(&mut self, cuts: &BTreeMap<(u32, u32), f32>) {
        let mut middle = BTreeMap::new();
        for (&(a, b), &t) in cuts {
            let [p, q] = [a, b].map(|v| self.mesh.positions[v as usize]);
            middle.insert((a, b), (self.mesh.positions.len() as u32, t));
            self.mesh.positions.push(p.lerp(q, t));
            let blended = blended(&self.influences[a as usize], &self.influences[b as usize], t);
            self.influences.push(blended);
        }
        let triangles = std::mem::take(&mut self.mesh.triangles);
        for (triangle, (face, places)) in triangles.into_iter().zip(std::mem::take(&mut self.parts)) {
            let corners = [0, 1, 2].map(|k| Corner { vertex: triangle[k], place: places[k] });
            let cuts = [0, 1, 2].map(|k| {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                let &(vertex, t) = middle.get(&(a.vertex.min(b.vertex), a.vertex.max(b.vertex)))?;
                let t = if a.vertex < b.vertex { t } else { 1.0 - t };
                Some(Corner { vertex, place: a.place.lerp(b.place, t) })
            });
            let positions = &self.mesh.positions;
            let distance = |a: Corner, b: Corner| positions[a.vertex as usize].distance(positions[b.vertex as usize]);
            for piece in pieces(corners, cuts, distance) {
                self.mesh.triangles.push(piece.map(|corner| corner.vertex));
                self.parts.push((face, piece.map(|corner| corner.place)));
            }
        }
    }
}

/// A vertex, and where it is on the face that was split.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Corner {
    vertex: u32,
    place: Vec3,
}

/// A face in pieces, `cuts` being the new vertices on its edges; of the two ways to divide what is left of it beside a
/// corner, the one with the shorter edge.
fn pieces(
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
        // Turned until an edge that is cut comes first and one that is not comes last.
        [ab, bc, ca] => pieces([b, c, a], [bc, ca, ab], distance),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::animation::arm;
    use crate::geometry::Topology;

    /// A tube of square section along x from 0 to 2 around the arm, `rings` rings of four vertices, open at the ends;
    /// weights run from bone 0 to 1 around x = 0.9, which is where the elbow bends.
    fn tube(rings: usize) -> Model {
        let mut model = arm();
        for i in 0..rings {
            let x = 2.0 * i as f32 / (rings - 1) as f32;
            for [y, z] in [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]] {
                model.surface.positions.push(Vec3::new(x, y, z));
                let second = (0.5 + (x - 0.9)).clamp(0.0, 1.0);
                model.surface.influences.push(blended(&Influences::rigid(0), &Influences::rigid(1), second));
            }
        }
        for ring in 0..rings as u32 - 1 {
            for k in 0..4 {
                let [a, b] = [4 * ring + k, 4 * ring + (k + 1) % 4];
                model.surface.triangles.extend([[a, a + 4, b + 4], [a, b + 4, b]]);
            }
        }
        model.surface.normals = vec![Vec3::Y; model.surface.positions.len()];
        model.surface.material = vec![0; model.surface.triangles.len()];
        model
    }

    fn mesh(model: &Model) -> TriMesh {
        TriMesh { positions: model.surface.positions.clone(), triangles: model.surface.triangles.clone() }
    }

    #[test]
    fn a_plane_stands_where_two_bones_are_equal_across_the_limb() {
        let planes = joint_planes(&tube(41), 0.15);
        assert_eq!(planes.len(), 1);
        assert!(planes[0].centre.distance(Vec3::X * 0.9) < 1e-5, "{planes:?}");
        assert_eq!((planes[0].normal, planes[0].joints), (Vec3::X, [0, 1]));
    }

    #[test]
    fn a_limb_gets_a_closed_loop_of_vertices_on_the_plane() {
        let (planes, coarse) = (joint_planes(&tube(41), 0.15), tube(5));
        let before = mesh(&coarse);
        let split = split_along(&coarse, &before, &coarse.surface.influences, &planes, 100);
        // Four long edges and four diagonals are cut, of the eight faces between the second ring and the third.
        assert_eq!((split.mesh.positions.len(), split.mesh.triangles.len()), (20 + 8, 32 + 16));
        assert!(split.mesh.positions[20..].iter().all(|p| (p.x - 0.9).abs() < 1e-5));
        assert_eq!(split.mesh.positions[..20], before.positions);
        let topology = Topology::of(&split.mesh);
        assert_eq!((topology.edges.boundary, topology.edges.non_manifold, topology.degenerate), (8, 0, 0));
        for ((face, places), triangle) in split.parts.iter().zip(&split.mesh.triangles) {
            let corners = before.corners(*face as usize);
            for (place, &v) in places.iter().zip(triangle) {
                let p = corners[0] * place.x + corners[1] * place.y + corners[2] * place.z;
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
    fn what_hangs_on_other_bones_is_not_cut() {
        let (planes, mut coarse) = (joint_planes(&tube(41), 0.15), tube(5));
        coarse.surface.influences.fill(Influences::rigid(2));
        let split = split_along(&coarse, &mesh(&coarse), &coarse.surface.influences, &planes, 100);
        assert_eq!(split.mesh, mesh(&coarse));
    }

    #[test]
    fn rigid_parts_have_no_planes() {
        let mut model = tube(41);
        model.surface.influences.fill(Influences::rigid(1));
        assert_eq!(joint_planes(&model, 0.5), []);
    }
}
