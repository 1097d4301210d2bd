//! Samples of the source at each texel.

use glam::Vec3;
use rayon::prelude::*;

use super::coverage::keep_coverage;
use super::probe::Probe;
use super::texel_map::{Texel, TexelMap};
use crate::Cancellation;
use crate::data::{Atlas, Cards, NO_CARD, Parts, TriMesh};
use crate::geometry::{BoundingSphere, Bvh};
use crate::render::{SurfaceSample, SurfaceSampler};

/// Distance from the level, to either side, within which rays look for the source, as a fraction of the radius of the
/// source's bounding sphere.
const RAY_DISTANCE: f32 = 0.03;
/// Ray distance on a card, as a multiple of the reach of the leaves that it shows.
const CARD_RAY_DISTANCE: f32 = 1.01;
/// Alpha from which on a point is not cut out.
const OPAQUE: f32 = 0.5;
/// Fewest points that are sampled in one task.
const POINTS_PER_TASK: usize = 1024;

/// Samples one source for the texels of its levels.
#[derive(Clone, Copy)]
pub struct Baker<'a> {
    /// Materials of the source.
    pub sampler: &'a SurfaceSampler<'a>,
    /// Over the source's triangles.
    pub bvh: &'a Bvh,
    /// Of the source.
    pub bounding_sphere: BoundingSphere,
}

/// A level with its place in the texture.
#[derive(Clone, Copy)]
pub struct BakeTarget<'a> {
    /// The level. World space.
    pub mesh: &'a TriMesh,
    /// Texture coordinates of its faces.
    pub atlas: &'a Atlas,
    /// The atlas, rasterised.
    pub texels: &'a TexelMap,
    /// Faces that are cut-out cards, if any are.
    pub cards: Option<&'a Cards>,
    /// What the cards show grows to its area in the source: leaves that lie at an angle and overlap.
    pub keeps_area: bool,
    /// Parts of the source that the faces show: of each, the nearest point, not the outermost surface.
    pub parts: Option<&'a Parts>,
}

impl Baker<'_> {
    /// Samples the source at every texel that a triangle covers: along the level's smooth normal, from outside inwards, the
    /// first surface within the ray distance that faces outwards; failing that, or where parts are told, the nearest point. Leaves on cards then
    /// grow to the area of the source's leaves, if asked for.
    ///
    /// Returns one sample a texel. If cancelled, the remaining ones are `None`.
    pub fn bake(&self, target: &BakeTarget<'_>, cancellation: &Cancellation) -> Vec<Option<SurfaceSample>> {
        let mut samples = self.sample_texels(target, cancellation);
        if let Some(cards) = target.cards.filter(|_| target.keeps_area) {
            keep_coverage(&mut samples, target.texels, self.sampler, target.mesh, cards);
        }
        samples
    }

    fn sample_texels(&self, target: &BakeTarget<'_>, cancellation: &Cancellation) -> Vec<Option<SurfaceSample>> {
        let areas = texel_areas(target);
        let level = LevelSurface::new(target.mesh, target.cards, target.parts);
        let sample = |texel: &Option<Texel>| {
            let texel = texel.filter(|_| !cancellation.is_cancelled())?;
            self.sample(&level, &texel, areas[texel.triangle as usize])
        };
        target.texels.texels.par_iter().with_min_len(target.texels.size).map(sample).collect()
    }

    /// For each point of a level, true if the source is not cut out there. `areas` has the area that a point of each face
    /// stands for.
    pub fn shown(&self, mesh: &TriMesh, cards: Option<&Cards>, points: &[Texel], areas: &[f32]) -> Vec<bool> {
        let level = LevelSurface::new(mesh, cards, None);
        let is_shown = |point: &Texel| {
            let sample = self.sample(&level, point, areas[point.triangle as usize]);
            sample.is_some_and(|sample| sample.color.w >= OPAQUE)
        };
        points.par_iter().with_min_len(POINTS_PER_TASK).map(is_shown).collect()
    }

    /// The source at one point of a level, for a texel that stands for `area`.
    fn sample(&self, level: &LevelSurface<'_>, texel: &Texel, area: f32) -> Option<SurfaceSample> {
        let LevelSurface { mesh, normals, cards, parts } = level;
        let ray_distance = RAY_DISTANCE * self.bounding_sphere.radius;
        let position = texel.interpolate(&mesh.triangles, &mesh.positions);
        let normal = texel.interpolate(&mesh.triangles, normals).normalize_or(Vec3::Y);
        let group = cards.map(|cards| (cards, cards.group[texel.triangle as usize]));
        let probe = Probe { sampler: self.sampler, bvh: self.bvh, ray_distance, area, group };
        match group {
            Some((cards, card)) if card != NO_CARD => {
                let ray_distance = cards.reach[card as usize] * CARD_RAY_DISTANCE;
                Some(Probe { ray_distance, ..probe }.sample_card(position, normal))
            }
            _ => match parts {
                Some(parts) => probe.sample_part(position, parts, parts.of_faces[texel.triangle as usize]),
                None => probe.sample_surface(position, normal),
            },
        }
    }
}

/// The surface of a level.
struct LevelSurface<'a> {
    mesh: &'a TriMesh,
    normals: Vec<Vec3>,
    cards: Option<&'a Cards>,
    parts: Option<&'a Parts>,
}

impl<'a> LevelSurface<'a> {
    fn new(mesh: &'a TriMesh, cards: Option<&'a Cards>, parts: Option<&'a Parts>) -> Self {
        Self { mesh, normals: mesh.vertex_normals(), cards, parts }
    }
}

/// Area in space that one texel of each face stands for.
pub(super) fn texel_areas(target: &BakeTarget<'_>) -> Vec<f32> {
    let BakeTarget { mesh, atlas, texels, .. } = *target;
    let area = |t: usize| {
        let [a, b, c] = atlas.uvs[t].map(|uv| uv * texels.size as f32);
        0.5 * mesh.area_vector(t).length() / (0.5 * (b - a).perp_dot(c - a).abs()).max(1e-6)
    };
    (0..mesh.triangles.len()).map(area).collect()
}
