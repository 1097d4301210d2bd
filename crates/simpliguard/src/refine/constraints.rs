//! Constraints on the optimisation: no step may flip a face or make the mesh intersect itself. Steps that do are rolled back.

use std::collections::HashSet;

use glam::Vec3;

use super::low_poly::LowPoly;
use crate::data::{TriMesh, area_vector};
use crate::geometry::intersecting_pairs;
use crate::geometry::self_intersection::SLIDING_PAIRS;

/// Rounds in which vertices keep [`KEEP`] of their displacement. In later rounds they keep none of it.
const ROUNDS: usize = 8;
/// Fraction of the displacement that vertices of intersecting faces keep in each round.
const KEEP: f32 = 0.7;
/// Smallest cosine between a face's initial and present normal.
const SMALLEST_COSINE: f32 = 0.05;
/// Smallest fraction of its initial area that a face must keep.
const SMALLEST_AREA: f32 = 0.01;

/// The initial mesh, which steps are compared with.
pub(super) struct Constraints {
    mesh: TriMesh,
    /// Pairs of faces that intersected initially.
    pairs: HashSet<(u32, u32)>,
    /// Pairs of their corners, if they may slide.
    sliding_corners: HashSet<(u32, u32)>,
}

impl Constraints {
    /// Takes `low` as the initial mesh.
    pub(super) fn new(low: &LowPoly) -> Self {
        let mesh = low.mesh();
        let pairs = intersecting_pairs(&mesh);
        let may_slide = pairs.len() as f64 > SLIDING_PAIRS * mesh.triangles.len() as f64;
        let sliding_corners = pairs.iter().filter(|_| may_slide).flat_map(|&pair| corner_pairs(&mesh, pair)).collect();
        Self { pairs: pairs.into_iter().collect(), sliding_corners, mesh }
    }

    /// Moves vertices back towards their initial positions until no face is flipped and no pair intersects that did not
    /// intersect initially. Pairs next to the initial ones stay if they may slide.
    pub(super) fn roll_back_invalid_steps(&self, low: &mut LowPoly) {
        for round in 0.. {
            // The initial mesh is valid, and each round moves a vertex towards it: the loop ends there at the latest.
            let flipped = self.flipped(low);
            let keep = if round < ROUNDS { KEEP } else { 0.0 };
            let intersecting = if flipped.is_empty() { self.newly_intersecting(&low.mesh()) } else { Vec::new() };
            if flipped.is_empty() && intersecting.is_empty() {
                return;
            }
            self.move_back(&flipped, 0.0, &mut low.positions);
            self.move_back(&intersecting, keep, &mut low.positions);
        }
    }

    /// Scales the displacement of the corners of `faces` by `keep`.
    fn move_back(&self, faces: &[[u32; 3]], keep: f32, positions: &mut [Vec3]) {
        let mut vertices: Vec<u32> = faces.iter().flatten().copied().collect();
        vertices.sort_unstable();
        vertices.dedup();
        for v in vertices {
            let origin = self.mesh.positions[v as usize];
            let p = &mut positions[v as usize];
            *p = if keep > 0.0 { origin + (*p - origin) * keep } else { origin };
        }
    }

    /// Faces that have flipped, or lost their area.
    fn flipped(&self, low: &LowPoly) -> Vec<[u32; 3]> {
        let flipped = |&t: &usize| {
            let (origin, corners) = (self.mesh.corners(t), low.corners(t));
            let (old, new) = (area_vector(origin), area_vector(corners));
            let turned = old.dot(new) <= SMALLEST_COSINE * old.length() * new.length();
            corners != origin && (turned || new.length() < SMALLEST_AREA * old.length())
        };
        let faces = 0..self.mesh.triangles.len();
        faces.filter(flipped).map(|t| self.mesh.triangles[t]).collect()
    }

    /// Faces that intersect others and did not initially.
    fn newly_intersecting(&self, mesh: &TriMesh) -> Vec<[u32; 3]> {
        let slides = |pair| corner_pairs(&self.mesh, pair).any(|corners| self.sliding_corners.contains(&corners));
        let pairs = intersecting_pairs(mesh).into_iter();
        let new = pairs.filter(|pair| !self.pairs.contains(pair) && !slides(*pair));
        new.flat_map(|(a, b)| [mesh.triangles[a as usize], mesh.triangles[b as usize]]).collect()
    }
}

/// A corner of one face and one of the other, the lower index first.
fn corner_pairs(mesh: &TriMesh, (a, b): (u32, u32)) -> impl Iterator<Item = (u32, u32)> {
    let [a, b] = [a, b].map(|t| mesh.triangles[t as usize]);
    a.into_iter().flat_map(move |u| b.map(|v| (u.min(v), u.max(v))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Atlas;
    use crate::geometry::self_intersecting;
    use crate::refine::TexelGrid;

    /// A tent over a floor. Vertex 3 is the tip.
    fn tent() -> LowPoly {
        let positions = vec![
            Vec3::new(-1.0, -1.0, 0.0),
            Vec3::new(1.0, -1.0, 0.0),
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::new(0.0, 0.0, 1.0),
            Vec3::new(-9.0, -9.0, -1.0),
            Vec3::new(9.0, -9.0, -1.0),
            Vec3::new(0.0, 9.0, -1.0),
        ];
        let triangles = vec![[0, 1, 3], [1, 2, 3], [2, 0, 3], [4, 5, 6]];
        let atlas = Atlas { uvs: vec![Default::default(); 4], ..Atlas::default() };
        LowPoly::new(&TriMesh { positions, triangles }, &atlas, false, TexelGrid::empty())
    }

    #[test]
    fn steps_that_harm_nothing_stay() {
        let mut low = tent();
        let constraints = Constraints::new(&low);
        low.positions[3].z = 1.5;
        low.positions[4].x = -8.0;
        let moved = low.positions.clone();
        constraints.roll_back_invalid_steps(&mut low);
        assert_eq!(low.positions, moved);
    }

    #[test]
    fn a_base_pushed_through_the_floor_comes_back_above_it() {
        let mut low = tent();
        let constraints = Constraints::new(&low);
        low.positions[0].z = -1.2;
        constraints.roll_back_invalid_steps(&mut low);
        assert!(!self_intersecting(&low.mesh()).contains(&true));
        assert!(low.positions[0].z < -0.5 && low.positions[3] == tent().positions[3], "{:?}", low.positions);
    }

    /// The tent, two of its faces pierced by a needle, over the floor.
    fn pierced() -> LowPoly {
        let TriMesh { mut positions, mut triangles } = tent().mesh();
        positions.extend([Vec3::new(-2.0, 0.0, 0.45), Vec3::new(2.0, -0.05, 0.5), Vec3::new(2.0, 0.05, 0.5)]);
        triangles.push([7, 8, 9]);
        let atlas = Atlas { uvs: vec![Default::default(); 5], ..Atlas::default() };
        LowPoly::new(&TriMesh { positions, triangles }, &atlas, false, TexelGrid::empty())
    }

    #[test]
    fn what_passes_through_each_other_may_slide_but_pierces_nothing_else() {
        let mut low = pierced();
        let constraints = Constraints::new(&low);
        assert_eq!(constraints.pairs.len(), 2);
        // Through the third face of the tent, which shares its corners with the others.
        low.positions[8] = Vec3::new(1.0, -1.0, 0.3);
        low.positions[9] = Vec3::new(1.1, -0.9, 0.3);
        let slid = low.positions.clone();
        assert!(intersecting_pairs(&low.mesh()).iter().any(|pair| !constraints.pairs.contains(pair)));
        constraints.roll_back_invalid_steps(&mut low);
        assert_eq!(low.positions, slid);
        // Through the floor.
        low.positions[8].z = -3.0;
        constraints.roll_back_invalid_steps(&mut low);
        assert!(intersecting_pairs(&low.mesh()).iter().all(|&(a, b)| a != 3 && b != 3));
    }

    #[test]
    fn a_face_that_turns_over_goes_all_the_way_back() {
        let mut low = tent();
        let constraints = Constraints::new(&low);
        low.positions[3] = Vec3::new(0.0, -5.0, -0.5);
        constraints.roll_back_invalid_steps(&mut low);
        assert_eq!(low.positions, tent().positions);
    }
}
