//! What the source shows at each texel.

use glam::Vec3;
use rayon::prelude::*;

use super::Texel;
use crate::bvh::{Bvh, Hit, barycentric};
use crate::mesh::TriMesh;
use crate::render::{Footprint, Frame, SurfaceSample, SurfaceSampler};
use crate::unwrap::Atlas;

/// How far from the level the source is looked for, as a part of the frame's radius.
const CAGE: f32 = 0.03;

/// Samples the source at every texel that a triangle covers: along the level's smooth normal, from outside inwards, the
/// first surface within the cage that faces outwards; failing that, the nearest point.
pub fn bake(
    sampler: &SurfaceSampler<'_>,
    bvh: &Bvh,
    frame: &Frame,
    mesh: &TriMesh,
    atlas: &Atlas,
    texels: &[Option<Texel>],
    size: usize,
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
            let texel = (*texel)?;
            let corners = mesh.triangles[texel.triangle as usize].map(|v| v as usize);
            let b = texel.barycentric;
            let at = |values: &[Vec3]| values[corners[0]] * b.x + values[corners[1]] * b.y + values[corners[2]] * b.z;
            let (position, normal) = (at(&mesh.positions), at(&normals).normalize_or(Vec3::Y));
            let hit = find(sampler, bvh, position, normal, cage)?;
            Some(sample(sampler, &hit, texel_area[texel.triangle as usize]))
        })
        .collect()
}

fn find(sampler: &SurfaceSampler<'_>, bvh: &Bvh, position: Vec3, normal: Vec3, cage: f32) -> Option<Hit> {
    let surface = &sampler.model().surface;
    let faces_outwards = |t: u32| {
        let [a, b, c] = surface.triangles[t as usize].map(|v| surface.positions[v as usize]);
        sampler.material(t as usize).double_sided || (b - a).cross(c - a).dot(normal) > 0.0
    };
    let from = position + normal * cage;
    bvh.cast_where(from, -normal, 2.0 * cage, |t, _| faces_outwards(t)).or_else(|| bvh.closest(position, f32::INFINITY))
}

fn sample(sampler: &SurfaceSampler<'_>, hit: &Hit, area: f32) -> SurfaceSample {
    let surface = &sampler.model().surface;
    let corners = surface.triangles[hit.triangle as usize].map(|v| surface.positions[v as usize]);
    let [a, b, c] = corners;
    let footprint = Footprint::new(area, 0.5 * (b - a).cross(c - a).length());
    sampler.sample(hit.triangle as usize, Vec3::from(barycentric(hit.point, corners)), footprint)
}
