//! Which connected part of the source each vertex of a level belongs to.
//!
//! Where two parts of the source touch, as a head on its collar, the closest point may lie on the wrong one, which only
//! shows when they move apart. A connected part of the level is therefore matched as a whole: with as few parts of the
//! source as lie within a tolerance of all its vertices.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use crate::data::{Influences, Model, Surface, TriMesh};
use crate::geometry::{Bvh, DisjointSets, Hit, first_equal, position_bits};

/// How much farther than the closest point a point on another part may be, as a fraction of the diagonal of the source's
/// bounding box.
const TOLERANCE: f32 = 0.01;
/// Fewest vertices that speak for a further part of the source.
const SUPPORT: usize = 3;

/// A source, as its influences are taken over.
pub struct SkinSource<'a> {
    pub(super) model: &'a Model,
    bvh: &'a Bvh,
    /// Connected part of each triangle.
    parts: Vec<u32>,
    /// In metres.
    tolerance: f32,
}

impl<'a> SkinSource<'a> {
    /// A source whose triangles `bvh` holds.
    pub fn new(model: &'a Model, bvh: &'a Bvh) -> Self {
        let (low, high) = crate::data::bounds(&model.surface.positions);
        let moves = model.rig.is_some() || model.surface.morphs.is_some();
        let parts = if moves { parts(&model.surface) } else { Vec::new() };
        Self { model, bvh, parts, tolerance: TOLERANCE * low.distance(high) }
    }

    /// A number for the connected part of the source that each triangle belongs to. Empty for a source that keeps still.
    pub fn parts(&self) -> &[u32] {
        &self.parts
    }

    /// Influences at a point of one of its triangles.
    pub fn influences_at(&self, triangle: u32, point: Vec3) -> Influences {
        crate::animation::influences_at(&self.model.surface, triangle as usize, point)
    }

    /// The closest point of the source for each vertex of `mesh`, on a part that its surroundings share.
    pub(super) fn closest(&self, mesh: &TriMesh) -> Vec<Option<Hit>> {
        let nearest: Vec<Option<Hit>> =
            mesh.positions.par_iter().map(|&p| self.bvh.closest(p, f32::INFINITY)).collect();
        let mut out = nearest.clone();
        let pieces = pieces(mesh);
        let settled: Vec<Vec<(u32, Hit)>> =
            pieces.par_iter().map(|piece| self.settle(piece, &mesh.positions, &nearest)).collect();
        for (v, hit) in settled.into_iter().flatten() {
            out[v as usize] = Some(hit);
        }
        out
    }

    /// The vertices of a piece of the level whose closest point lies on a part that the piece does not belong to, and
    /// where they belong.
    fn settle(&self, piece: &[u32], positions: &[Vec3], nearest: &[Option<Hit>]) -> Vec<(u32, Hit)> {
        let own = |v: u32| nearest[v as usize].map_or(u32::MAX, |hit| self.parts[hit.triangle as usize]);
        let mut open: Vec<u32> = piece.to_vec();
        let mut chosen = Vec::new();
        let mut covered: Vec<(u32, Hit)> = Vec::new();
        loop {
            let mut votes: BTreeMap<u32, usize> = BTreeMap::new();
            open.iter().for_each(|&v| *votes.entry(own(v)).or_default() += 1);
            let favourite = votes.into_iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
            let least = if chosen.is_empty() { 1 } else { SUPPORT };
            let Some((part, _)) = favourite.filter(|(_, votes)| *votes >= least) else { break };
            chosen.push(part);
            open.retain(|&v| {
                if own(v) == part {
                    return false;
                }
                let reach = nearest[v as usize].map_or(0.0, |hit| hit.distance) + self.tolerance;
                let on_part = |t: u32| self.parts[t as usize] == part;
                let found = self.bvh.closest_where(positions[v as usize], reach, on_part);
                covered.extend(found.map(|hit| (v, hit)));
                found.is_none()
            });
        }
        for v in open {
            let on_chosen = |t: u32| chosen.contains(&self.parts[t as usize]);
            covered.extend(self.bvh.closest_where(positions[v as usize], f32::INFINITY, on_chosen).map(|hit| (v, hit)));
        }
        covered.retain(|&(v, _)| !chosen.contains(&own(v)));
        covered
    }
}

/// A number for the connected part of each triangle; vertices in one place are one.
fn parts(surface: &Surface) -> Vec<u32> {
    let first = first_equal(surface.positions.len(), |v| position_bits(surface.positions[v]));
    let mut sets = DisjointSets::new(surface.positions.len());
    for [a, b, c] in surface.triangles.iter().map(|t| t.map(|v| first[v as usize] as usize)) {
        sets.join(a, b);
        sets.join(b, c);
    }
    surface.triangles.iter().map(|t| sets.find(first[t[0] as usize] as usize) as u32).collect()
}

/// The vertices of each connected piece of a mesh.
fn pieces(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let mut sets = DisjointSets::new(mesh.positions.len());
    for [a, b, c] in mesh.triangles.iter().map(|t| t.map(|v| v as usize)) {
        sets.join(a, b);
        sets.join(b, c);
    }
    let mut pieces = vec![Vec::new(); mesh.positions.len()];
    for v in 0..mesh.positions.len() {
        pieces[sets.find(v)].push(v as u32);
    }
    pieces.retain(|piece| !piece.is_empty());
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Rig;

    /// Two quads in one plane, from x = 0 to 1 and from 1.001 to 3: parts of their own.
    fn model() -> Model {
        let quad =
            |from: f32, to: f32| [[from, 0.0], [to, 0.0], [to, 1.0], [from, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let surface = Surface {
            positions: [quad(0.0, 1.0), quad(1.001, 3.0)].concat(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
            ..Surface::default()
        };
        let rig = Some(Rig { bones: Vec::new(), source_skin: None, poses: Vec::new() });
        Model { surface, rig, ..Model::empty("tiles") }
    }

    fn tiles(triangles: Vec<[u32; 3]>) -> Vec<u32> {
        let model = model();
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        // The last vertex of the first tile is pulled over the gap.
        let x = [0.0, 0.5, 0.0, 1.002, 1.5, 2.0, 2.0, 1.5];
        let positions = x.iter().enumerate().map(|(i, &x)| Vec3::new(x, 0.3 * (i % 4) as f32, 0.0)).collect();
        let closest = SkinSource::new(&model, &bvh).closest(&TriMesh { positions, triangles });
        closest.iter().map(|hit| hit.expect("a source").triangle / 2).collect()
    }

    #[test]
    fn a_vertex_that_strays_over_another_part_stays_with_its_piece() {
        let apart = tiles(vec![[0, 1, 2], [1, 3, 2], [4, 5, 6], [4, 6, 7]]);
        assert_eq!(apart, [0, 0, 0, 0, 1, 1, 1, 1]);
    }

    #[test]
    fn a_piece_over_two_parts_takes_the_closest_points_of_both() {
        let joined = tiles(vec![[0, 1, 2], [1, 3, 2], [3, 5, 6], [4, 6, 7], [3, 4, 5]]);
        assert_eq!(joined, [0, 0, 0, 1, 1, 1, 1, 1]);
    }

    #[test]
    fn vertices_without_faces_take_their_own_closest_point() {
        assert_eq!(tiles(Vec::new()), [0, 0, 0, 1, 1, 1, 1, 1]);
    }
}
