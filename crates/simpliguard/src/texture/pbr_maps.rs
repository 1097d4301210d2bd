//! From samples of the source to the images of a level.

use glam::{Vec3, Vec4, Vec4Swizzles};
use image::{Rgb, RgbImage, Rgba, RgbaImage};

use super::encode::encode_normal;
use super::material::MaterialStatistics;
use super::texel_map::TexelMap;
use crate::data::TextureFormat;
use crate::data::{LevelMesh, LevelTextures, linear_to_srgb, srgb_to_linear, to_byte};
use crate::render::{SurfaceSample, fill_unknown};

/// The normal of the mesh in a normal map.
const FLAT: [u8; 3] = [128, 128, 255];

/// Images that a level gets besides its base colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Tangent-space normals.
    pub normal: bool,
    /// Alpha in the base colour's image, as a mask.
    pub alpha: bool,
    /// Storage format of colours.
    pub format: TextureFormat,
}

/// The images of a level, and the statistics for the factors that go with them.
///
/// `samples` has one entry a texel, `colors` is the refined texture, sRGB encoded. A surface that glows is black in the
/// image of base colours; its colour goes into the image of emission.
pub fn pbr_maps(
    mesh: &LevelMesh,
    map: &TexelMap,
    samples: &[Option<SurfaceSample>],
    colors: &[Vec4],
    channels: Channels,
) -> (LevelTextures, MaterialStatistics) {
    let painter = Painter { samples, size: map.size };
    let statistics = MaterialStatistics::of(samples, channels.alpha);
    let normal = |i: usize, s: &SurfaceSample| encode_normal(mesh, map.texels[i], s.normal);
    let rough_metal = |_, s: &SurfaceSample| Vec3::new(s.occlusion, s.roughness, s.metallic);
    let emitted = |i: usize, s: &SurfaceSample| {
        let light = if s.glows { colors[i].xyz().map(srgb_to_linear) } else { s.emissive };
        (light / statistics.emissive).map(linear_to_srgb)
    };
    let mut textures = LevelTextures {
        base_color: match statistics.base_color {
            Some(_) => None,
            None => Some(painter.base_color(colors, statistics.glows, channels.alpha)),
        },
        normal: channels.normal.then(|| painter.rgb(normal)).filter(|image| !is_flat(image)),
        occlusion_roughness_metallic: statistics.rough_metal.then(|| painter.rgb(rough_metal)),
        emissive: (statistics.emissive != Vec3::ZERO).then(|| painter.rgb(emitted)),
        format: channels.format,
    };
    if let Some(light) = textures.emissive.as_ref().filter(|_| !statistics.glows).and_then(one_colour) {
        textures.emissive = None;
        return (
            textures,
            MaterialStatistics { emissive: statistics.emissive * light.map(srgb_to_linear), ..statistics },
        );
    }
    (textures, statistics)
}

/// A normal map says nothing but the normals of the mesh, but for the rounding of a byte.
fn is_flat(image: &RgbImage) -> bool {
    image.pixels().all(|pixel| pixel.0.iter().zip(FLAT).all(|(a, b)| a.abs_diff(b) <= 1))
}

/// The colour of all texels, if they have one.
fn one_colour(image: &RgbImage) -> Option<Vec3> {
    let first = image.pixels().next()?;
    image.pixels().all(|pixel| pixel == first).then(|| Vec3::from(first.0.map(f32::from)) / f32::from(u8::MAX))
}

/// Paints images of `size` x `size` texels, gutters included.
struct Painter<'a> {
    samples: &'a [Option<SurfaceSample>],
    size: usize,
}

impl Painter<'_> {
    /// The refined texture, black where the source glows, with its alpha if wanted.
    fn base_color(&self, colors: &[Vec4], glows: bool, alpha: bool) -> RgbaImage {
        let alpha = alpha.then(|| self.paint(|_| true, |_, s| Vec4::splat(s.color.w)));
        let reflected =
            glows.then(|| self.paint(SurfaceSample::is_seen, |i, s| if s.glows { Vec4::ZERO } else { colors[i] }));
        let base_color = reflected.as_deref().unwrap_or(colors);
        RgbaImage::from_fn(self.size as u32, self.size as u32, |x, y| {
            let i = y as usize * self.size + x as usize;
            let [r, g, b] = base_color[i].xyz().to_array().map(to_byte);
            Rgba([r, g, b, alpha.as_ref().map_or(255, |a| to_byte(a[i].x))])
        })
    }

    fn rgb(&self, value: impl Fn(usize, &SurfaceSample) -> Vec3) -> RgbImage {
        let texels = self.paint(SurfaceSample::is_seen, |i, s| value(i, s).extend(1.0));
        RgbImage::from_fn(self.size as u32, self.size as u32, |x, y| {
            let texel = texels[y as usize * self.size + x as usize];
            Rgb(texel.xyz().to_array().map(to_byte))
        })
    }

    /// `value` of each texel whose sample is `known`, by its index and sample; the others are filled from them.
    fn paint(
        &self,
        known: impl Fn(&SurfaceSample) -> bool,
        value: impl Fn(usize, &SurfaceSample) -> Vec4,
    ) -> Vec<Vec4> {
        let known: Vec<bool> = self.samples.iter().map(|s| s.as_ref().is_some_and(&known)).collect();
        let mut out: Vec<Vec4> =
            self.samples.iter().enumerate().map(|(i, s)| s.as_ref().map_or(Vec4::ZERO, |s| value(i, s))).collect();
        fill_unknown(&mut out, &known, self.size);
        out
    }
}
