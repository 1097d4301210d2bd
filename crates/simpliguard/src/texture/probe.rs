//! Rays from one texel to the source.

use glam::{Vec3, Vec4};

use crate::data::{AlphaMode, Cards, NO_CARD, Parts, area_vector};
use crate::geometry::{Bvh, Hit, barycentric};
use crate::render::{Footprint, SurfaceSample, SurfaceSampler};

/// Distance within which the wood of foliage is looked for before the nearest point is taken, which may lie on a leaf. In
/// ray distances.
const WOOD_DISTANCE: f32 = 4.0;
/// The gap between the leaves of a card.
const CLEAR: SurfaceSample = SurfaceSample {
    color: Vec4::ZERO,
    glows: false,
    normal: Vec3::Y,
    is_inverted: false,
    occlusion: 1.0,
    roughness: 1.0,
    metallic: 0.0,
    emissive: Vec3::ZERO,
};

/// Samples the source around one texel.
pub(super) struct Probe<'a> {
    pub(super) sampler: &'a SurfaceSampler<'a>,
    pub(super) bvh: &'a Bvh,
    /// Distance from the level within which rays look for the source.
    pub(super) ray_distance: f32,
    /// Area in space that the texel stands for.
    pub(super) area: f32,
    /// The cards of the level, and the one that the texel lies on, or [`NO_CARD`].
    pub(super) group: Option<(&'a Cards, u32)>,
}

impl Probe<'_> {
    /// The source at a texel at `position`.
    pub(super) fn sample_surface(&self, position: Vec3, normal: Vec3) -> Option<SurfaceSample> {
        let hit = self.first_hit(position, normal).or_else(|| self.bvh.closest(position, f32::INFINITY))?;
        Some(self.sample(&hit))
    }

    /// The point of a part of the source that is nearest to `position`.
    pub(super) fn sample_part(&self, position: Vec3, parts: &Parts, part: u32) -> Option<SurfaceSample> {
        let hit = self.bvh.closest_where(position, f32::INFINITY, |t| parts.of_source[t as usize] == part)?;
        Some(self.sample(&hit))
    }

    /// A card at `position`: the triangles of its own group from either side, clear between them. The normal is that of the card.
    pub(super) fn sample_card(&self, position: Vec3, normal: Vec3) -> SurfaceSample {
        let hit = self.cast_within(self.ray_distance, position, normal);
        hit.map_or(CLEAR, |hit| SurfaceSample { normal, is_inverted: false, ..self.sample(&hit) })
    }

    /// The first surface within the ray distance; in foliage also within [`WOOD_DISTANCE`].
    fn first_hit(&self, position: Vec3, normal: Vec3) -> Option<Hit> {
        let wood = || self.group.and_then(|_| self.cast_within(WOOD_DISTANCE * self.ray_distance, position, normal));
        self.cast_within(self.ray_distance, position, normal).or_else(wood)
    }

    /// Casts a ray inwards through `position`, from `distance` outside the level to `distance` inside it.
    fn cast_within(&self, distance: f32, position: Vec3, normal: Vec3) -> Option<Hit> {
        self.cast(position + normal * distance, -normal, 2.0 * distance)
    }

    /// The first surface along a ray that faces its origin and is not cut out there.
    fn cast(&self, from: Vec3, direction: Vec3, length: f32) -> Option<Hit> {
        let surface = &self.sampler.model().surface;
        self.bvh.cast_where(from, direction, length, |t, point| {
            let t = t as usize;
            let corners = surface.triangles[t].map(|v| surface.positions[v as usize]);
            let material = self.sampler.material(t);
            let card = match self.group {
                Some((cards, group)) if cards.source_group[t] != group => return false,
                Some((_, group)) => group != NO_CARD,
                None => false,
            };
            if !card && !material.double_sided && area_vector(corners).dot(direction) >= 0.0 {
                return false;
            }
            match material.alpha_mode {
                AlphaMode::Mask { cutoff } => {
                    let b = Vec3::from(barycentric(point, corners));
                    self.sampler.color(t, b, self.footprint(corners)).w >= cutoff
                }
                _ => true,
            }
        })
    }

    fn sample(&self, hit: &Hit) -> SurfaceSample {
        let surface = &self.sampler.model().surface;
        let corners = surface.triangles[hit.triangle as usize].map(|v| surface.positions[v as usize]);
        let b = Vec3::from(barycentric(hit.point, corners));
        self.sampler.sample(hit.triangle as usize, b, self.footprint(corners))
    }

    fn footprint(&self, corners: [Vec3; 3]) -> Footprint {
        Footprint::new(self.area, 0.5 * area_vector(corners).length())
    }
}
