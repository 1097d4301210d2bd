//! What the source shows at each texel.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::Texel;
use crate::Cancellation;
use crate::data::{AlphaMode, Atlas, Cards, NO_CARD, TriMesh};
use crate::geometry::{BoundingSphere, Bvh, Hit, barycentric};
use crate::render::{Footprint, SurfaceSample, SurfaceSampler};

/// How far from the level the source is looked for, as a part of the frame's radius.
const CAGE: f32 = 0.03;
/// Most blended surfaces seen through one texel.
const LAYERS: usize = 4;
/// How far the wood of a foliage is looked for before the nearest point, which may be a leaf, in cages.
const FAR: f32 = 4.0;
/// How far behind a blended surface the next may lie, in cages.
const BEHIND: f32 = 8.0;

/// Samples the source at every texel that a triangle covers: along the level's smooth normal, from outside inwards, the
/// first surface within the cage that faces outwards; failing that, the nearest point.
pub fn bake(
    sampler: &SurfaceSampler<'_>,
    bvh: &Bvh,
    frame: &BoundingSphere,
    mesh: &TriMesh,
    atlas: &Atlas,
    texels: &[Option<Texel>],
    size: usize,
    cards: Option<&Cards>,
    cancellation: &Cancellation,
) -> Vec<Option<SurfaceSample>> {
    let normals = mesh.vertex_normals();
    let cage = CAGE * frame.radius;
    // Area in space that one texel of each triangle stands for.
    let texel_area: Vec<f32> = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = atlas.uvs[t].map(|uv| uv * size as f32);
            0.5 * mesh.area_vector(t).length() / (0.5 * (b - a).perp_dot(c - a).abs()).max(1e-6)
        })
        .collect();
    texels
        .par_iter()
        .with_min_len(size)
        .map(|texel| {
            let texel = texel.filter(|_| !cancellation.is_cancelled())?;
            let corners = mesh.triangles[texel.triangle as usize].map(|v| v as usize);
            let b = texel.barycentric;
            let at = |values: &[Vec3]| values[corners[0]] * b.x + values[corners[1]] * b.y + values[corners[2]] * b.z;
            let (position, normal) = (at(&mesh.positions), at(&normals).normalize_or(Vec3::Y));
            let area = texel_area[texel.triangle as usize];
            let group = cards.map(|c| (c, c.group[texel.triangle as usize]));
            let eye = Eye { sampler, bvh, cage, area, group };
            match group {
                Some((cards, card)) if card != NO_CARD => {
                    let cage = cards.reach[card as usize] * 1.01;
                    Some(Eye { cage, ..eye }.look_through(position, normal))
                }
                _ => eye.look(position, normal),
            }
        })
        .collect()
}

/// What lies between the leaves of a card.
const CLEAR: SurfaceSample = SurfaceSample {
    color: Vec4::ZERO,
    glows: false,
    normal: Vec3::Y,
    occlusion: 1.0,
    roughness: 1.0,
    metallic: 0.0,
    emissive: Vec3::ZERO,
};

/// Looks at the source around one texel.
struct Eye<'a> {
    sampler: &'a SurfaceSampler<'a>,
    bvh: &'a Bvh,
    cage: f32,
    /// Area in space that the texel stands for.
    area: f32,
    /// The cards of the level, and the one that the texel lies on, or [`NO_CARD`].
    group: Option<(&'a Cards, u32)>,
}

impl Eye<'_> {
    /// What the texel at `position` shows: blended surfaces let through what lies behind them.
    fn look(&self, position: Vec3, normal: Vec3) -> Option<SurfaceSample> {
        let from = position + normal * self.cage;
        let far = || {
            self.group.and_then(|_| self.cast(position + normal * (FAR * self.cage), -normal, 2.0 * FAR * self.cage))
        };
        let Some(hit) = self.cast(from, -normal, 2.0 * self.cage).or_else(far) else {
            return Some(self.sample(&self.bvh.closest(position, f32::INFINITY)?));
        };
        let mut seen = self.sample(&hit);
        let mut last = hit;
        for _ in 1..LAYERS {
            let alpha = seen.color.w;
            let blended = self.sampler.material(last.triangle as usize).alpha_mode == AlphaMode::Blend;
            if !blended || alpha > 0.99 {
                break;
            }
            let start = last.point - normal * (1e-3 * self.cage);
            let Some(next) = self.cast(start, -normal, BEHIND * self.cage) else { break };
            seen = over(&seen, &self.sample(&next));
            last = next;
        }
        Some(seen)
    }

    /// What a card shows: its own group's triangles from either side, nothing between them.
    fn look_through(&self, position: Vec3, normal: Vec3) -> SurfaceSample {
        let hit = self.cast(position + normal * self.cage, -normal, 2.0 * self.cage);
        hit.map_or(CLEAR, |hit| SurfaceSample { normal, ..self.sample(&hit) })
    }

    /// The first surface along a ray that faces its origin and is not cut out there.
    fn cast(&self, from: Vec3, direction: Vec3, length: f32) -> Option<Hit> {
        let surface = &self.sampler.model().surface;
        self.bvh.cast_where(from, direction, length, |t, point| {
            let t = t as usize;
            let corners = surface.triangles[t].map(|v| surface.positions[v as usize]);
            let [a, b, c] = corners;
            let material = self.sampler.material(t);
            let card = match self.group {
                Some((cards, group)) if cards.source_group[t] != group => return false,
                Some((_, group)) => group != NO_CARD,
                None => false,
            };
            if !card && !material.double_sided && (b - a).cross(c - a).dot(direction) >= 0.0 {
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

    fn footprint(&self, [a, b, c]: [Vec3; 3]) -> Footprint {
        Footprint::new(self.area, 0.5 * (b - a).cross(c - a).length())
    }
}

/// A blended surface over what is behind it. The shape is that of the more solid one, and so is whether it glows.
fn over(front: &SurfaceSample, back: &SurfaceSample) -> SurfaceSample {
    let alpha = front.color.w;
    let shape = if alpha > 0.5 { front } else { back };
    let mix = |front: f32, back: f32| front * alpha + back * (1.0 - alpha);
    let color = front.color.truncate() * alpha + back.color.truncate() * (1.0 - alpha);
    SurfaceSample {
        color: color.extend(alpha + back.color.w * (1.0 - alpha)),
        glows: shape.glows,
        normal: shape.normal,
        occlusion: mix(front.occlusion, back.occlusion),
        roughness: mix(front.roughness, back.roughness),
        metallic: mix(front.metallic, back.metallic),
        emissive: front.emissive * alpha + back.emissive * (1.0 - alpha),
    }
}
