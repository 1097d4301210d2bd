//! Normals of a level at the corners of its faces: several at a vertex where the source has a crease.

use glam::{Vec3, Vec4};

use super::texel_map::TexelMap;
use crate::data::{Atlas, TriMesh};
use crate::render::SurfaceSample;

/// Cosine of the least angle between the source's normals on both sides of a crease.
const CREASE: f32 = 0.8;
/// Cosine of the largest angle between the normal of the mesh and that of the source around a vertex.
const LEAST_AGREEMENT: f32 = 0.5;
/// The weight of a sample at a corner is this power of its barycentric coordinate: samples near the corner decide.
const NEARNESS: i32 = 4;

/// The faces of one chart around one vertex.
struct Fan {
    /// Face and corner.
    corners: Vec<(usize, usize)>,
    /// Sum of face normals, weighted by corner angle.
    normal: Vec3,
    /// Sum of the source's normals, weighted by area and corner angle; zero if no texel lies there.
    source: Vec3,
}

/// Unit normal of each corner of each face: the mean of the source's normals around it, by area and angle. Where a crease of
/// the source runs along a border of charts, each side has its own; within a chart, texels of both sides would mix. So a wall
/// is about as flat as the source's, whatever is at its rim, and its normal map has little to undo.
///
/// `samples` has one entry a texel.
pub fn corner_normals(
    mesh: &TriMesh,
    atlas: &Atlas,
    texels: &TexelMap,
    samples: &[Option<SurfaceSample>],
) -> Vec<[Vec3; 3]> {
    let source = source_normals(mesh, texels, samples);
    let mut normals = vec![[Vec3::Y; 3]; mesh.triangles.len()];
    for fans in fans_of_vertices(mesh, atlas, &source) {
        let side = sides(&fans);
        for (i, fan) in fans.iter().enumerate() {
            let of_side = fans.iter().zip(&side).filter(|(_, s)| **s == side[i]);
            let normal = normal(of_side.map(|(fan, _)| fan));
            fan.corners.iter().for_each(|&(t, k)| normals[t][k] = normal);
        }
    }
    normals
}

/// The source's normal around a vertex. The mesh's if nothing is known of the source, or if the two have little in common.
fn normal<'f>(fans: impl Iterator<Item = &'f Fan> + Clone) -> Vec3 {
    let of_mesh = fans.clone().map(|fan| fan.normal).sum::<Vec3>().normalize_or(Vec3::Y);
    let of_source = fans.map(|fan| fan.source).sum::<Vec3>().normalize_or_zero();
    if of_source.dot(of_mesh) < LEAST_AGREEMENT { of_mesh } else { of_source }
}

/// The mean of the source's normals near each corner, on the side that the face looks to, times the area of the face and its
/// angle there.
fn source_normals(mesh: &TriMesh, texels: &TexelMap, samples: &[Option<SurfaceSample>]) -> Vec<[Vec3; 3]> {
    let mut sums = vec![[Vec4::ZERO; 3]; mesh.triangles.len()];
    for (texel, sample) in texels.texels.iter().zip(samples) {
        let (Some(texel), Some(sample)) = (texel, sample) else { continue };
        let t = texel.triangle as usize;
        let is_behind = sample.normal.dot(mesh.area_vector(t)) < 0.0;
        let normal = if is_behind { -sample.normal } else { sample.normal };
        for (k, sum) in sums[t].iter_mut().enumerate() {
            *sum += normal.extend(1.0) * texel.barycentric[k].max(0.0).powi(NEARNESS);
        }
    }
    let of_corner = |t: usize, k: usize| {
        let (sum, angle) = (sums[t][k], mesh.corner_normal(t, k).length());
        sum.truncate() * (mesh.area_vector(t).length() * angle / sum.w.max(f32::MIN_POSITIVE))
    };
    (0..sums.len()).map(|t| [0, 1, 2].map(|k| of_corner(t, k))).collect()
}

/// The fans of each vertex that has faces, charts in a fixed order.
fn fans_of_vertices(mesh: &TriMesh, atlas: &Atlas, source: &[[Vec3; 3]]) -> Vec<Vec<Fan>> {
    let corner = |(t, k): (usize, usize)| {
        let uv = atlas.uvs[t][k];
        ((mesh.triangles[t][k], [uv.x.to_bits(), uv.y.to_bits()]), (t, k))
    };
    let faces = 0..mesh.triangles.len();
    let mut corners: Vec<_> = faces.flat_map(|t| [0, 1, 2].map(|k| corner((t, k)))).collect();
    corners.sort_unstable();
    let fan = |corners: &[((u32, [u32; 2]), (usize, usize))]| {
        let corners: Vec<(usize, usize)> = corners.iter().map(|c| c.1).collect();
        let normal = corners.iter().map(|&(t, k)| mesh.corner_normal(t, k)).sum();
        let source = corners.iter().map(|&(t, k)| source[t][k]).sum();
        Fan { corners, normal, source }
    };
    corners
        .chunk_by(|a, b| a.0.0 == b.0.0)
        .map(|vertex| vertex.chunk_by(|a, b| a.0 == b.0).map(fan).collect())
        .collect()
}

/// For each fan of a vertex, the first one on its side of all creases. Fans without samples are on the side of the first.
fn sides(fans: &[Fan]) -> Vec<usize> {
    let mut side: Vec<usize> = (0..fans.len()).collect();
    for i in 1..fans.len() {
        for j in 0..i {
            let (a, b) = (&fans[i].source, &fans[j].source);
            let is_crease = *a != Vec3::ZERO && *b != Vec3::ZERO && a.normalize().dot(b.normalize()) < CREASE;
            let (from, to) = (side[i].max(side[j]), side[i].min(side[j]));
            if !is_crease && from != to {
                side.iter_mut().filter(|s| **s == from).for_each(|s| *s = to);
            }
        }
    }
    side
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

    /// A roof of two squares that meet in the edge from the origin along y, one chart each, and the samples of a source with
    /// these normals.
    fn roof(left: Vec3, right: Vec3) -> Vec<[Vec3; 3]> {
        let positions = vec![
            Vec3::ZERO,
            Vec3::Y,
            Vec3::new(1.0, 0.0, -1.0),
            Vec3::new(1.0, 1.0, -1.0),
            Vec3::new(-1.0, 0.0, -1.0),
            Vec3::new(-1.0, 1.0, -1.0),
        ];
        let triangles = vec![[0, 2, 3], [0, 3, 1], [4, 0, 1], [4, 1, 5]];
        // The right square lies in the right half of the texture, the left one in the left half.
        let uv = |x: f32, v: u32| Vec2::new(0.5 + 0.5 * x, positions[v as usize].y * 0.9);
        let place = |t: usize, v: u32| {
            let x = positions[v as usize].x;
            if t < 2 { uv(0.1 + 0.8 * x, v) } else { uv(-0.1 + 0.8 * x, v) }
        };
        let uvs = triangles.iter().enumerate().map(|(t, f): (_, &[u32; 3])| f.map(|v| place(t, v))).collect();
        let (mesh, atlas) = (TriMesh { positions, triangles }, Atlas { uvs, ..Atlas::default() });
        let texels = TexelMap::new(&atlas, 32);
        let sample = |triangle: u32| SurfaceSample {
            color: Vec4::ONE,
            glows: false,
            normal: if triangle < 2 { right } else { left }.normalize(),
            is_inverted: false,
            occlusion: 1.0,
            roughness: 1.0,
            metallic: 0.0,
            emissive: Vec3::ZERO,
        };
        let samples: Vec<_> = texels.texels.iter().map(|t| t.map(|t| sample(t.triangle))).collect();
        corner_normals(&mesh, &atlas, &texels, &samples)
    }

    #[test]
    fn a_crease_of_the_source_has_a_normal_on_each_side() {
        let (left, right) = (Vec3::new(-1.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0));
        let normals = roof(left, right);
        let (left, right) = (left.normalize(), right.normalize());
        assert!(normals[..2].iter().flatten().all(|n| n.distance(right) < 1e-6), "{normals:?}");
        assert!(normals[2..].iter().flatten().all(|n| n.distance(left) < 1e-6), "{normals:?}");
    }

    #[test]
    fn a_smooth_source_has_one_normal_at_a_vertex_of_two_charts() {
        let normals = roof(Vec3::new(-0.3, 0.0, 1.0), Vec3::new(0.3, 0.0, 1.0));
        for [t, k] in [[0, 0], [1, 0], [1, 2], [2, 1], [2, 2], [3, 1]] {
            assert!(normals[t][k].distance(Vec3::Z) < 1e-6, "corner {k} of face {t}: {}", normals[t][k]);
        }
    }
}
