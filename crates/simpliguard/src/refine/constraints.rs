//! Takes back vertex steps that turned faces over or made the mesh pass through itself.

use std::collections::HashSet;

use glam::Vec3;

use super::LowPoly;
use crate::data::TriMesh;
use crate::geometry::intersecting_pairs;

/// Rounds in which vertices go a part of their way back; after them they go all of it.
const ROUNDS: usize = 8;
/// Part of their way that they keep in each.
const KEEP: f32 = 0.7;
/// Parts of a mesh with more than this part of its faces in pairs that pass through each other may slide along each other:
/// new pairs may join them, next to the old ones.
const FULL_HANDICAP: f64 = 0.015;

/// A mesh as descent was given it.
pub(super) struct Constraints {
    mesh: TriMesh,
    /// Pairs of faces that passed through each other then.
    pairs: HashSet<(u32, u32)>,
    /// Pairs of their corners, if the mesh was self_intersecting.
    corners: HashSet<(u32, u32)>,
}

impl Constraints {
    pub(super) fn new(low: &LowPoly) -> Self {
        let mesh = low.mesh();
        let pairs = intersecting_pairs(&mesh);
        let self_intersecting = pairs.len() as f64 > FULL_HANDICAP * mesh.triangles.len() as f64;
        let corners = pairs.iter().filter(|_| self_intersecting).flat_map(|&pair| corner_pairs(&mesh, pair)).collect();
        Self { pairs: pairs.into_iter().collect(), corners, mesh }
    }

    /// Moves vertices back towards where they began until every face is upright and no pair passes through each other that
    /// did not then, but for those next to old ones in a self_intersecting mesh.
    pub(super) fn roll_back_invalid_steps(&self, low: &mut LowPoly) {
        for round in 0.. {
            // At its beginning a face is upright and no pair is made: each round moves a vertex until all are there.
            let turned: Vec<[u32; 3]> = self.turned(&low.positions);
            let keep = if round < ROUNDS { KEEP } else { 0.0 };
            let made = if turned.is_empty() { self.made(low.mesh()) } else { Vec::new() };
            if turned.is_empty() && made.is_empty() {
                return;
            }
            self.move_back(&turned, 0.0, &mut low.positions);
            self.move_back(&made, keep, &mut low.positions);
        }
    }

    /// Keeps a part of how far the corners of `faces` have moved.
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

    /// Faces that have turned over, or lost their area, since the beginning.
    fn turned(&self, positions: &[Vec3]) -> Vec<[u32; 3]> {
        let normal = |p: &[Vec3], t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| p[v as usize]);
            (b - a).cross(c - a)
        };
        let origin = &self.mesh.positions;
        let turned = |t: &&[u32; 3]| {
            let (old, new) = (normal(origin, t), normal(positions, t));
            let moved = t.iter().any(|&v| positions[v as usize] != origin[v as usize]);
            moved && (old.dot(new) <= 0.05 * old.length() * new.length() || new.length() < 0.01 * old.length())
        };
        self.mesh.triangles.iter().filter(turned).copied().collect()
    }

    /// Faces that pass through each other and did not at the beginning.
    fn made(&self, mesh: TriMesh) -> Vec<[u32; 3]> {
        let is_next_to_old = |pair| corner_pairs(&self.mesh, pair).any(|corners| self.corners.contains(&corners));
        let made = intersecting_pairs(&mesh).into_iter();
        let made = made.filter(|pair| !self.pairs.contains(pair) && !is_next_to_old(*pair));
        made.flat_map(|(a, b)| [mesh.triangles[a as usize], mesh.triangles[b as usize]]).collect()
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

    /// A tent over a floor, seen from above: the tip is vertex 3.
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
        LowPoly::new(&TriMesh { positions, triangles }, &atlas, false, 1, Vec::new(), Vec::new())
    }

    #[test]
    fn steps_that_harm_nothing_stay() {
        let mut low = tent();
        let guard = Constraints::new(&low);
        low.positions[3].z = 1.5;
        low.positions[4].x = -8.0;
        let moved = low.positions.clone();
        guard.roll_back_invalid_steps(&mut low);
        assert_eq!(low.positions, moved);
    }

    #[test]
    fn a_base_pushed_through_the_floor_comes_back_above_it() {
        let mut low = tent();
        let guard = Constraints::new(&low);
        low.positions[0].z = -1.2;
        guard.roll_back_invalid_steps(&mut low);
        assert!(!self_intersecting(&low.mesh()).contains(&true));
        assert!(low.positions[0].z < -0.5 && low.positions[3] == tent().positions[3], "{:?}", low.positions);
    }

    /// The tent, two of its faces pierced by a needle, over the floor.
    fn pierced() -> LowPoly {
        let TriMesh { mut positions, mut triangles } = tent().mesh();
        positions.extend([Vec3::new(-2.0, 0.0, 0.45), Vec3::new(2.0, -0.05, 0.5), Vec3::new(2.0, 0.05, 0.5)]);
        triangles.push([7, 8, 9]);
        let atlas = Atlas { uvs: vec![Default::default(); 5], ..Atlas::default() };
        LowPoly::new(&TriMesh { positions, triangles }, &atlas, false, 1, Vec::new(), Vec::new())
    }

    #[test]
    fn what_passes_through_each_other_may_slide_but_pierces_nothing_else() {
        let mut low = pierced();
        let guard = Constraints::new(&low);
        assert_eq!(guard.pairs.len(), 2);
        // Through the third face of the tent, which shares its corners with the others.
        low.positions[8] = Vec3::new(1.0, -1.0, 0.3);
        low.positions[9] = Vec3::new(1.1, -0.9, 0.3);
        let slid = low.positions.clone();
        assert!(intersecting_pairs(&low.mesh()).iter().any(|pair| !guard.pairs.contains(pair)));
        guard.roll_back_invalid_steps(&mut low);
        assert_eq!(low.positions, slid);
        // Through the floor.
        low.positions[8].z = -3.0;
        guard.roll_back_invalid_steps(&mut low);
        assert!(intersecting_pairs(&low.mesh()).iter().all(|&(a, b)| a != 3 && b != 3));
    }

    #[test]
    fn a_face_that_turns_over_goes_all_the_way_back() {
        let mut low = tent();
        let guard = Constraints::new(&low);
        low.positions[3] = Vec3::new(0.0, -5.0, -0.5);
        guard.roll_back_invalid_steps(&mut low);
        assert_eq!(low.positions, tent().positions);
    }
}
