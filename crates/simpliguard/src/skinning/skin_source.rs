//! The source of a skin: closest points on the right connected component.
//!
//! Where two components of the source touch, such as a head and its collar, the closest point may lie on the wrong one.
//! The error only shows when they move apart. Therefore each connected component of the level is matched as a whole,
//! with as few components of the source as lie within a tolerance of all its vertices.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use crate::animation::influences_at;
use crate::data::{Influences, Model, Surface, TriMesh, bounds};
use crate::geometry::{Bvh, Hit, face_components, first_coincident, group_by_component, vertex_components};

/// Largest additional distance of a point on another component, compared with the closest point, as a fraction of the
/// diagonal of the source's bounding box.
const TOLERANCE: f32 = 0.01;
/// Fewest vertices that choose a further component of the source.
const FEWEST_VOTES: usize = 3;
/// The component of a vertex for which the source has no closest point.
const NO_COMPONENT: u32 = u32::MAX;

/// A source from which influences and morph targets are transferred.
pub struct SkinSource<'a> {
    pub(super) model: &'a Model,
    bvh: &'a Bvh,
    /// Connected component of each triangle; empty for a source that does not move.
    components: Vec<u32>,
    /// Largest additional distance of a point on another component, in metres.
    tolerance: f32,
}

impl<'a> SkinSource<'a> {
    /// The skin source of a model. `bvh` holds the triangles of the model.
    pub fn new(model: &'a Model, bvh: &'a Bvh) -> Self {
        let (low, high) = bounds(&model.surface.positions);
        let moves = model.rig.is_some() || model.surface.morphs.is_some();
        let components = if moves { components(&model.surface) } else { Vec::new() };
        Self { model, bvh, components, tolerance: TOLERANCE * low.distance(high) }
    }

    /// The connected component of each triangle of the source. Empty for a source that does not move.
    pub fn components(&self) -> &[u32] {
        &self.components
    }

    /// Influences at a point of a triangle of the source.
    pub fn influences_at(&self, triangle: u32, point: Vec3) -> Influences {
        influences_at(&self.model.surface, triangle as usize, point)
    }

    /// The closest point of the source for each vertex of `mesh`, on a component that matches the connected component
    /// of the vertex.
    pub(super) fn closest(&self, mesh: &TriMesh) -> Vec<Option<Hit>> {
        let nearest: Vec<Option<Hit>> =
            mesh.positions.par_iter().map(|&p| self.bvh.closest(p, f32::INFINITY)).collect();
        let mut out = nearest.clone();
        let components = vertex_components(mesh.positions.len(), mesh.triangles.iter().copied());
        let corrected: Vec<Vec<(u32, Hit)>> = group_by_component(&components)
            .par_iter()
            .map(|vertices| self.corrected(vertices, &mesh.positions, &nearest))
            .collect();
        for (v, hit) in corrected.into_iter().flatten() {
            out[v as usize] = Some(hit);
        }
        out
    }

    /// The vertices of a connected component of the level whose nearest point lies on a component of the source that
    /// does not match, each with its point on a matching one. The vertices vote for the matching components of the
    /// source; those that have a point within the tolerance on a chosen component vote no further.
    fn corrected(&self, vertices: &[u32], positions: &[Vec3], nearest: &[Option<Hit>]) -> Vec<(u32, Hit)> {
        let own = |v: u32| nearest[v as usize].map_or(NO_COMPONENT, |hit| self.components[hit.triangle as usize]);
        let mut open: Vec<u32> = vertices.to_vec();
        let mut chosen = Vec::new();
        let mut covered: Vec<(u32, Hit)> = Vec::new();
        loop {
            let mut votes: BTreeMap<u32, usize> = BTreeMap::new();
            open.iter().for_each(|&v| *votes.entry(own(v)).or_default() += 1);
            let favourite = votes.into_iter().reduce(|best, next| if next.1 > best.1 { next } else { best });
            let least = if chosen.is_empty() { 1 } else { FEWEST_VOTES };
            let Some((component, _)) = favourite.filter(|(_, votes)| *votes >= least) else { break };
            chosen.push(component);
            open.retain(|&v| {
                if own(v) == component {
                    return false;
                }
                let reach = nearest[v as usize].map_or(0.0, |hit| hit.distance) + self.tolerance;
                let is_chosen = |t: u32| self.components[t as usize] == component;
                let found = self.bvh.closest_where(positions[v as usize], reach, is_chosen);
                covered.extend(found.map(|hit| (v, hit)));
                found.is_none()
            });
        }
        for v in open {
            let is_chosen = |t: u32| chosen.contains(&self.components[t as usize]);
            covered.extend(self.bvh.closest_where(positions[v as usize], f32::INFINITY, is_chosen).map(|hit| (v, hit)));
        }
        covered.retain(|&(v, _)| !chosen.contains(&own(v)));
        covered
    }
}

/// The connected component of each triangle; vertices at one position are one.
fn components(surface: &Surface) -> Vec<u32> {
    let first = first_coincident(&surface.positions);
    let welded: Vec<[u32; 3]> = surface.triangles.iter().map(|t| t.map(|v| first[v as usize])).collect();
    face_components(surface.positions.len(), &welded)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Rig;

    /// Two quads in one plane, from x = 0 to 1 and from 1.001 to 3: two components.
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
        // The last vertex of the first tile lies beyond the gap.
        let x = [0.0, 0.5, 0.0, 1.002, 1.5, 2.0, 2.0, 1.5];
        let positions = x.iter().enumerate().map(|(i, &x)| Vec3::new(x, 0.3 * (i % 4) as f32, 0.0)).collect();
        let closest = SkinSource::new(&model, &bvh).closest(&TriMesh { positions, triangles });
        closest.iter().map(|hit| hit.expect("a source").triangle / 2).collect()
    }

    #[test]
    fn a_vertex_beyond_the_gap_stays_with_its_component() {
        let apart = tiles(vec![[0, 1, 2], [1, 3, 2], [4, 5, 6], [4, 6, 7]]);
        assert_eq!(apart, [0, 0, 0, 0, 1, 1, 1, 1]);
    }

    #[test]
    fn a_component_over_two_takes_the_closest_points_of_both() {
        let joined = tiles(vec![[0, 1, 2], [1, 3, 2], [3, 5, 6], [4, 6, 7], [3, 4, 5]]);
        assert_eq!(joined, [0, 0, 0, 1, 1, 1, 1, 1]);
    }

    #[test]
    fn vertices_without_faces_take_their_own_closest_point() {
        assert_eq!(tiles(Vec::new()), [0, 0, 0, 1, 1, 1, 1, 1]);
    }
}
