//! From samples of the source to the images of a level, and from the welded mesh to the one with chart borders.

use std::collections::HashMap;

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use image::{Rgb, RgbImage, Rgba, RgbaImage};

use super::{Texel, fill};
use crate::data::{
    AlphaMode, Atlas, Influences, LevelMaterial, LevelMesh, LevelMorph, LevelTextures, TriMesh, linear_to_srgb,
    srgb_to_linear,
};
use crate::render::SurfaceSample;
use crate::settings::TextureFormat;

/// Which images a level gets besides its base colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Tangent-space normals.
    pub normal: bool,
    /// Alpha in the base colour's image, as a mask.
    pub alpha: bool,
    /// How colours are stored.
    pub format: TextureFormat,
}

/// Splits vertices along chart borders and gives them normals, and MikkTSpace tangents if `tangents`.
pub fn level_mesh(
    mesh: &TriMesh,
    atlas: &Atlas,
    influences: &[Influences],
    morphs: &[LevelMorph],
    tangents: bool,
) -> LevelMesh {
    let normals = mesh.vertex_normals();
    let mut out = LevelMesh { morphs: vec![LevelMorph::default(); morphs.len()], ..LevelMesh::default() };
    let mut ids: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
    for (triangle, uvs) in mesh.triangles.iter().zip(&atlas.uvs) {
        let mut corners = [0; 3];
        for k in 0..3 {
            let (v, uv) = (triangle[k], uvs[k]);
            corners[k] = *ids.entry((v, [uv.x.to_bits(), uv.y.to_bits()])).or_insert_with(|| {
                out.positions.push(mesh.positions[v as usize]);
                out.normals.push(normals[v as usize]);
                out.uvs.push(uv);
                out.influences.extend(influences.get(v as usize));
                for (out, morph) in out.morphs.iter_mut().zip(morphs) {
                    out.positions.push(morph.positions[v as usize]);
                    out.normals.push(morph.normals[v as usize]);
                }
                out.positions.len() as u32 - 1
            });
        }
        out.triangles.push(corners);
    }
    if tangents {
        out.tangents = mikktspace(&out);
    }
    out
}

/// The images of a level, `colors` being the refined texture (encoded), and the factors that go with them. What glows is
/// black in the image of base colours, and its colour in that of emission.
pub fn maps(
    mesh: &LevelMesh,
    texels: &[Option<Texel>],
    samples: &[Option<SurfaceSample>],
    colors: &[Vec4],
    size: usize,
    channels: Channels,
) -> (LevelTextures, Varying) {
    let painter = Painter { samples, size };
    let varying = Varying::of(samples);
    let alpha = channels.alpha.then(|| painter.paint(|_, s| Vec4::splat(s.color.w)));
    let reflected = varying.glows.then(|| painter.paint(|i, s| if s.glows { Vec4::ZERO } else { colors[i] }));
    let base_color = reflected.as_deref().unwrap_or(colors);
    let emitted = |i: usize, s: &SurfaceSample| {
        let light = if s.glows { colors[i].xyz().map(srgb_to_linear) } else { s.emissive };
        (light / varying.emissive).map(linear_to_srgb)
    };
    let textures = LevelTextures {
        base_color: RgbaImage::from_fn(size as u32, size as u32, |x, y| {
            let i = y as usize * size + x as usize;
            let [r, g, b] = base_color[i].xyz().to_array().map(to_byte);
            Rgba([r, g, b, alpha.as_ref().map_or(255, |a| to_byte(a[i].x))])
        }),
        normal: channels.normal.then(|| painter.rgb(|i, s| encode_normal(mesh, texels[i], s.normal))),
        occlusion_roughness_metallic: varying
            .rough_metal
            .then(|| painter.rgb(|_, s| Vec3::new(s.occlusion, s.roughness, s.metallic))),
        emissive: (varying.emissive != Vec3::ZERO).then(|| painter.rgb(emitted)),
        format: channels.format,
    };
    (textures, varying)
}

/// What a material needs an image for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Varying {
    /// Occlusion, roughness or metalness varies over the level.
    pub rough_metal: bool,
    /// Mean roughness and metalness.
    pub roughness: f32,
    /// Mean metalness.
    pub metallic: f32,
    /// Brightest emission of each channel; zero in channels that are dark everywhere, unless another is not. One if
    /// anything glows.
    pub emissive: Vec3,
    /// Something does nothing but emit light.
    pub glows: bool,
}

impl Varying {
    fn of(samples: &[Option<SurfaceSample>]) -> Self {
        let (mut low, mut high, mut sum, mut count) = (Vec3::MAX, Vec3::MIN, Vec3::ZERO, 0.0);
        let mut emissive = Vec3::ZERO;
        for s in samples.iter().flatten() {
            let v = Vec3::new(s.occlusion, s.roughness, s.metallic);
            (low, high, sum, count) = (low.min(v), high.max(v), sum + v, count + 1.0);
            emissive = emissive.max(s.emissive);
        }
        let mean = if count > 0.0 { sum / count } else { Vec3::new(1.0, 1.0, 0.0) };
        let glows = samples.iter().flatten().any(|s| s.glows);
        let emissive = match emissive.max_element() > 1.0 / 255.0 {
            _ if glows => emissive.max(Vec3::ONE),
            true => emissive.max(Vec3::splat(1e-3)),
            false => Vec3::ZERO,
        };
        Self {
            rough_metal: (high - low).max_element() > 1.5 / 255.0,
            roughness: mean.y,
            metallic: mean.z,
            emissive,
            glows,
        }
    }
}

/// The factors of a level's material.
pub fn level_material(varying: &Varying, alpha: bool, double_sided: bool, unlit: bool) -> LevelMaterial {
    LevelMaterial {
        alpha_mode: if alpha { AlphaMode::Mask { cutoff: 0.5 } } else { AlphaMode::Opaque },
        double_sided,
        unlit,
        metallic: varying.metallic,
        roughness: varying.roughness,
        emissive: varying.emissive,
    }
}

struct Painter<'a> {
    samples: &'a [Option<SurfaceSample>],
    size: usize,
}

impl Painter<'_> {
    fn paint(&self, value: impl Fn(usize, &SurfaceSample) -> Vec4) -> Vec<Vec4> {
        let known: Vec<bool> = self.samples.iter().map(Option::is_some).collect();
        let mut out: Vec<Vec4> =
            self.samples.iter().enumerate().map(|(i, s)| s.as_ref().map_or(Vec4::ZERO, |s| value(i, s))).collect();
        fill(&mut out, &known, self.size);
        out
    }

    fn rgb(&self, value: impl Fn(usize, &SurfaceSample) -> Vec3) -> RgbImage {
        let texels = self.paint(|i, s| value(i, s).extend(1.0));
        RgbImage::from_fn(self.size as u32, self.size as u32, |x, y| {
            let texel = texels[y as usize * self.size + x as usize];
            Rgb(texel.xyz().to_array().map(to_byte))
        })
    }
}

/// A world-space normal in the tangent space of the level, as 0 to 1.
fn encode_normal(mesh: &LevelMesh, texel: Option<Texel>, normal: Vec3) -> Vec3 {
    let Some(texel) = texel else { return Vec3::new(0.5, 0.5, 1.0) };
    let corners = mesh.triangles[texel.triangle as usize].map(|v| v as usize);
    let b = texel.barycentric;
    let n = mesh.normals[corners[0]] * b.x + mesh.normals[corners[1]] * b.y + mesh.normals[corners[2]] * b.z;
    let t = mesh.tangents[corners[0]] * b.x + mesh.tangents[corners[1]] * b.y + mesh.tangents[corners[2]] * b.z;
    let handedness = mesh.tangents[corners[0]].w;
    let n = n.normalize_or(Vec3::Y);
    let t = t.xyz().normalize_or(n.any_orthonormal_vector());
    let bitangent = n.cross(t) * handedness;
    // A surface met from behind shows its other side.
    let normal = if normal.dot(n) < 0.0 { -normal } else { normal };
    // The frame of a low-poly mesh is not orthogonal: solve for the coordinates that shading will undo.
    let frame = glam::Mat3::from_cols(t, bitangent, n);
    let local = if frame.determinant().abs() > 1e-3 { frame.inverse() * normal } else { frame.transpose() * normal };
    local.normalize_or(Vec3::Z) * 0.5 + 0.5
}

fn to_byte(c: f32) -> u8 {
    (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// MikkTSpace tangents of a level; a vertex takes those of the last of its corners, which are all alike where charts are
/// split.
fn mikktspace(mesh: &LevelMesh) -> Vec<Vec4> {
    let mut geometry = Tangents { mesh, out: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); mesh.positions.len()] };
    // Fails only if a face has other than three or four corners, or there are more faces than 32 bits count.
    if let Err(error) = bevy_mikktspace::generate_tangents::<_, Portable>(&mut geometry) {
        tracing::warn!(?error, "no tangents");
    }
    geometry.out
}

struct Tangents<'a> {
    mesh: &'a LevelMesh,
    out: Vec<Vec4>,
}

/// The same last bit on every platform.
struct Portable;

impl bevy_mikktspace::Ops for Portable {
    fn sqrt(x: f32) -> f32 {
        x.sqrt()
    }

    fn acos(x: f32) -> f32 {
        libm::acos(f64::from(x)) as f32
    }
}

impl Tangents<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.triangles[face][corner] as usize
    }
}

impl bevy_mikktspace::Geometry<Portable> for Tangents<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.vertex(face, corner)].to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        // MikkTSpace has v upwards, glTF downwards.
        let uv = self.mesh.uvs[self.vertex(face, corner)];
        Vec2::new(uv.x, 1.0 - uv.y).to_array()
    }

    fn set_tangent(&mut self, space: Option<bevy_mikktspace::TangentSpace>, face: usize, corner: usize) {
        let vertex = self.vertex(face, corner);
        if let Some(space) = space {
            self.out[vertex] = Vec4::from(space.tangent_encoded());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A unit square in the plane z = 0 whose image is upright.
    fn square() -> (TriMesh, Atlas) {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let uv = |v: u32| Vec2::new(positions[v as usize].x, 1.0 - positions[v as usize].y);
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let uvs = triangles.iter().map(|t: &[u32; 3]| t.map(uv)).collect();
        (TriMesh { positions: positions.clone(), triangles }, Atlas { uvs, ..Atlas::default() })
    }

    #[test]
    fn an_upright_image_has_its_tangent_along_u_and_positive_handedness() {
        let (mesh, atlas) = square();
        let level = level_mesh(&mesh, &atlas, &[], &[], true);
        assert_eq!(level.positions.len(), 4);
        assert!(level.tangents.iter().all(|t| (*t - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-6));
    }

    #[test]
    fn normals_encode_to_blue_and_leaning_ones_towards_red_and_green() {
        let (mesh, atlas) = square();
        let level = level_mesh(&mesh, &atlas, &[], &[], true);
        let texel = Some(Texel { triangle: 0, barycentric: Vec3::splat(1.0 / 3.0) });
        let encoded = |n: Vec3| encode_normal(&level, texel, n.normalize());
        assert!((encoded(Vec3::Z) - Vec3::new(0.5, 0.5, 1.0)).length() < 1e-5);
        let leaning = encoded(Vec3::new(1.0, 1.0, 1.0));
        assert!(leaning.x > 0.7 && leaning.y > 0.7, "{leaning}");
    }

    #[test]
    fn a_vertex_on_a_chart_border_is_split() {
        let (mesh, mut atlas) = square();
        atlas.uvs[1] = atlas.uvs[1].map(|uv| uv * 0.5);
        assert_eq!(level_mesh(&mesh, &atlas, &[], &[], false).positions.len(), 6);
    }
}
