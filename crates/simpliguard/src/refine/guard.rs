//! Takes back vertex steps that turned faces over or made the mesh pass through itself.

use std::collections::HashSet;

use glam::Vec3;

use super::LowPoly;
use crate::mesh::{TriMesh, intersecting_pairs};

/// Rounds in which vertices go a part of their way back; after them they go all of it.
const ROUNDS: usize = 8;
/// Part of their way that they keep in each.
const KEEP: f32 = 0.7;
/// A mesh with more than this part of its faces in pairs that pass through each other is not kept from making more.
const TANGLED: f64 = 0.01;

/// A mesh as descent was given it.
pub(super) struct Guard {
    mesh: TriMesh,
    /// Pairs of faces that passed through each other then, unless they were too many to matter.
    pairs: Option<HashSet<(u32, u32)>>,
}

impl Guard {
    pub(super) fn new(low: &LowPoly) -> Self {
        let mesh = low.mesh();
        let pairs = intersecting_pairs(&mesh);
        let tangled = pairs.len() as f64 > TANGLED * mesh.triangles.len() as f64;
        Self { pairs: (!tangled).then(|| pairs.into_iter().collect()), mesh }
    }

    /// Moves vertices back towards where they began until every face is upright and no pair passes through each other that
    /// did not then.
    pub(super) fn take_back(&self, low: &mut LowPoly) {
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
        let Some(before) = &self.pairs else { return Vec::new() };
        let made = intersecting_pairs(&mesh).into_iter().filter(|pair| !before.contains(pair));
        made.flat_map(|(a, b)| [mesh.triangles[a as usize], mesh.triangles[b as usize]]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::self_intersecting;
    use crate::unwrap::Atlas;

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
        let guard = Guard::new(&low);
        low.positions[3].z = 1.5;
        low.positions[4].x = -8.0;
        let moved = low.positions.clone();
        guard.take_back(&mut low);
        assert_eq!(low.positions, moved);
    }

    #[test]
    fn a_base_pushed_through_the_floor_comes_back_above_it() {
        let mut low = tent();
        let guard = Guard::new(&low);
        low.positions[0].z = -1.2;
        guard.take_back(&mut low);
        assert!(!self_intersecting(&low.mesh()).contains(&true));
        assert!(low.positions[0].z < -0.5 && low.positions[3] == tent().positions[3], "{:?}", low.positions);
    }

    #[test]
    fn a_face_that_turns_over_goes_all_the_way_back() {
        let mut low = tent();
        let guard = Guard::new(&low);
        low.positions[3] = Vec3::new(0.0, -5.0, -0.5);
        guard.take_back(&mut low);
        assert_eq!(low.positions, tent().positions);
    }
}
