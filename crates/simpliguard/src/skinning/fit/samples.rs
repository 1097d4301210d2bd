//! Sample points on the faces of a level, and their errors in the poses.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use crate::animation::Poses;
use crate::data::{Influences, TriMesh};
use crate::skinning::closest_surface::{MatchLimits, closest_matches};
use crate::skinning::skin_source::SkinSource;

/// Number of times that each face is divided into four. The vertices are the sample points.
const DIVISIONS: usize = 2;

/// Barycentric coordinates of a point by vertex of its face. They sum to one; unused entries are zero.
type Coordinates = [(u32, f32); 3];

/// Points of the faces of a level.
pub(super) struct Samples {
    points: Vec<Vec3>,
    /// The barycentric coordinates of each point, by vertex of its face.
    coordinates: Vec<Coordinates>,
    /// Area that each point stands for; zero if the source has no match.
    areas: Vec<f32>,
    /// Influences of the source's closest point to each point.
    source: Vec<Influences>,
}

/// The error of the points in a pose.
pub(super) struct PoseError {
    /// Half the gradient of the error by the position of each vertex in the pose.
    pub(super) half_gradient: Vec<Vec3>,
    /// Sum of the squared distances to the source, weighted by areas.
    pub(super) total: f64,
}

impl Samples {
    /// The points of `mesh`: the vertices of its faces after [`DIVISIONS`].
    pub(super) fn new(source: &SkinSource<'_>, mesh: &TriMesh, limits: MatchLimits) -> Self {
        let mut fine = mesh.clone();
        let mut coordinates: Vec<Coordinates> =
            (0..mesh.positions.len() as u32).map(|v| [(v, 1.0), (v, 0.0), (v, 0.0)]).collect();
        for _ in 0..DIVISIONS {
            divide(&mut fine, &mut coordinates);
        }
        let closest = closest_matches(source, &fine, &fine.vertex_normals(), limits);
        let mut areas = vec![0.0; coordinates.len()];
        for (t, triangle) in fine.triangles.iter().enumerate() {
            let third = fine.area_vector(t).length() / 6.0;
            triangle.iter().filter(|&&v| closest[v as usize].is_match).for_each(|&v| areas[v as usize] += third);
        }
        let influences = closest.iter().map(|closest| closest.weights.strongest()).collect();
        Self { points: fine.positions, coordinates, areas, source: influences }
    }

    /// The error of each pose with the given influences of the vertices.
    pub(super) fn errors(&self, poses: &Poses<'_>, mesh: &TriMesh, influences: &[Influences]) -> Vec<PoseError> {
        let (own, source) = (poses.bind(influences), poses.bind(&self.source));
        let error = |pose: usize| {
            let own = poses.motions_into(pose, &own);
            let wanted = poses.motions_into(pose, &source);
            let posed: Vec<Vec3> =
                mesh.positions.iter().zip(&own).map(|(p, motion)| motion.transform_point3(*p)).collect();
            let mut out = PoseError { half_gradient: vec![Vec3::ZERO; posed.len()], total: 0.0 };
            let points = self.points.iter().zip(&self.coordinates).zip(&self.areas).zip(&wanted);
            for (((point, coordinates), &area), motion) in points {
                let position: Vec3 = coordinates.iter().map(|&(v, b)| posed[v as usize] * b).sum();
                let off = (position - motion.transform_point3(*point)) * area;
                coordinates.iter().for_each(|&(v, b)| out.half_gradient[v as usize] += off * b);
                out.total += if area > 0.0 { f64::from(off.length_squared() / area) } else { 0.0 };
            }
            out
        };
        (0..poses.all()).into_par_iter().map(error).collect()
    }

    /// The Gram matrix by rows: for two vertices, the product of their barycentric coordinates, summed over the points
    /// by area.
    pub(super) fn gram(&self, vertices: usize) -> Vec<Vec<(u32, f32)>> {
        let mut sums: BTreeMap<(u32, u32), f32> = BTreeMap::new();
        for (coordinates, &area) in self.coordinates.iter().zip(&self.areas).filter(|(_, area)| **area > 0.0) {
            for (u, a) in coordinates.iter().filter(|(_, b)| *b > 0.0) {
                for (v, b) in coordinates.iter().filter(|(_, b)| *b > 0.0) {
                    *sums.entry((*u, *v)).or_default() += area * a * b;
                }
            }
        }
        let mut rows = vec![Vec::new(); vertices];
        sums.into_iter().for_each(|((u, v), sum)| rows[u as usize].push((v, sum)));
        rows
    }
}

/// Divides each face into four.
fn divide(mesh: &mut TriMesh, coordinates: &mut Vec<Coordinates>) {
    let mut middles: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut triangles = Vec::with_capacity(4 * mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(u, v)| {
            *middles.entry((u.min(v), u.max(v))).or_insert_with(|| {
                mesh.positions.push((mesh.positions[u as usize] + mesh.positions[v as usize]) * 0.5);
                coordinates.push(halfway(&coordinates[u as usize], &coordinates[v as usize]));
                coordinates.len() as u32 - 1
            })
        });
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    mesh.triangles = triangles;
}

/// The coordinates of the point halfway between two points of a face.
fn halfway(a: &Coordinates, b: &Coordinates) -> Coordinates {
    let mut out = [(a[0].0, 0.0); 3];
    let mut used = 0;
    for &(vertex, coordinate) in a.iter().chain(b).filter(|(_, coordinate)| *coordinate > 0.0) {
        let slot = out[..used].iter().position(|(v, _)| *v == vertex).unwrap_or(used);
        used = used.max(slot + 1);
        out[slot] = (vertex, out[slot].1 + 0.5 * coordinate);
    }
    out
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Two quads in place of thirty-two.
    pub(crate) fn coarse() -> TriMesh {
        let positions =
            [0.0, 2.0, 4.0].iter().flat_map(|&x| [Vec3::new(x, 0.0, 0.0), Vec3::new(x, 1.0, 0.0)]).collect();
        TriMesh { positions, triangles: vec![[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]] }
    }

    #[test]
    fn points_of_a_divided_face_lie_at_their_coordinates() {
        let mut fine = coarse();
        let mut coordinates: Vec<Coordinates> = (0..6).map(|v| [(v, 1.0), (v, 0.0), (v, 0.0)]).collect();
        divide(&mut fine, &mut coordinates);
        divide(&mut fine, &mut coordinates);
        assert_eq!((fine.triangles.len(), fine.positions.len(), coordinates.len()), (64, 45, 45));
        for (point, coordinates) in fine.positions.iter().zip(&coordinates) {
            let position: Vec3 = coordinates.iter().map(|&(v, b)| coarse().positions[v as usize] * b).sum();
            assert!(position.distance(*point) < 1e-6);
        }
    }
}
