//! Mipmaps for the textures of levels and of their source. Textures of glTF files have no mipmaps, and Bevy makes none.
//! Without mipmaps, a distant model sparkles, and levels are seen from a distance. A source without mipmaps beside a level
//! that has some would change its look at each switch.
//!
//! The mean of 2 x 2 texels becomes one texel of the next mipmap: colours in linear light and weighted by alpha,
//! normals as vectors. The mipmaps are made while the file is loaded, in parallel to the game. The result replaces the
//! image of the loader.

use std::array::from_fn;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use bevy::asset::RenderAssetUsages;
use bevy::color::Srgba;
use bevy::gltf::{GltfAssetLabel, GltfLoaderSettings};
use bevy::image::{
    CompressedImageFormats, ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor, ImageType,
};
use bevy::platform::collections::HashSet;
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task};
use gltf::image::Source;
use gltf::material::AlphaMode;
use gltf::texture::{MagFilter, MinFilter, WrappingMode};

/// Smallest weight of a colour. Transparent texels count a little, because the sampler mixes them in at edges.
const LEAST_ALPHA: f32 = 1.0 / 255.0;
/// Number of steps of the table from linear light to bytes. They are smaller than the steps of a byte, even in the
/// dark.
const LIGHT_STEPS: usize = 4095;

static LIGHT_OF_BYTE: LazyLock<[f32; 256]> =
    LazyLock::new(|| from_fn(|byte| Srgba::gamma_function(byte as f32 / 255.0)));
static BYTE_OF_LIGHT: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let light = (0..=LIGHT_STEPS).map(|step| step as f32 / LIGHT_STEPS as f32);
    light.map(|light| to_byte(Srgba::gamma_function_inverse(light))).collect()
});

/// Makes the mipmaps of a file. Bevy clones it for each file.
#[derive(Clone)]
pub(super) struct Mipmaps {
    default_sampler: Arc<Mutex<ImageSamplerDescriptor>>,
    sampler: ImageSamplerDescriptor,
    /// Anisotropy of textures whose sampler has none.
    anisotropy: u16,
    /// True if the sampler replaces that of each texture.
    overrides: bool,
    usages: RenderAssetUsages,
    /// Textures whose mipmaps are done or on the way.
    begun: HashSet<usize>,
}

impl Mipmaps {
    /// `default_sampler` is the default of Bevy's loader.
    pub(super) fn new(default_sampler: Arc<Mutex<ImageSamplerDescriptor>>, anisotropy: u16) -> Self {
        Self {
            default_sampler,
            anisotropy: anisotropy.max(1),
            sampler: ImageSamplerDescriptor::default(),
            overrides: false,
            usages: RenderAssetUsages::default(),
            begun: HashSet::default(),
        }
    }

    /// Begins a file.
    pub(super) fn begin(&mut self, settings: &GltfLoaderSettings) {
        let default = || self.default_sampler.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.sampler = settings.default_sampler.clone().unwrap_or_else(default);
        self.overrides = settings.override_sampler;
        self.usages = settings.load_materials;
    }

    /// Starts to make the mipmaps of a material. Returns the label of each texture, and the task that makes
    /// its image.
    pub(super) fn start(
        &mut self,
        material: &gltf::Material<'_>,
        buffers: &[Vec<u8>],
    ) -> Vec<(GltfAssetLabel, Task<Option<Image>>)> {
        if self.usages.is_empty() {
            return Vec::new();
        }
        let new = textures(material).into_iter().filter(|(texture, _)| self.begun.insert(texture.index()));
        let new: Vec<_> = new.collect();
        new.into_iter().filter_map(|(texture, content)| self.task(&texture, content, buffers)).collect()
    }

    fn task(
        &self,
        texture: &gltf::Texture<'_>,
        content: Content,
        buffers: &[Vec<u8>],
    ) -> Option<(GltfAssetLabel, Task<Option<Image>>)> {
        let Source::View { view, mime_type } = texture.source().source() else { return None };
        let bytes = buffers.get(view.buffer().index())?.get(view.offset()..view.offset() + view.length())?.to_vec();
        let sampler = ImageSampler::Descriptor(self.sampler_of(&texture.sampler())?);
        let (mime_type, usages) = (mime_type.to_owned(), self.usages);
        let image = async move {
            let (format, none) = (ImageType::MimeType(&mime_type), CompressedImageFormats::NONE);
            let image = Image::from_buffer(&bytes, format, none, content.is_colour(), sampler, usages).ok()?;
            with_mipmaps(image, content)
        };
        Some((GltfAssetLabel::Texture(texture.index()), AsyncComputeTaskPool::get().spawn(image)))
    }

    /// The sampler of a texture with mipmaps: that of Bevy's loader, and anisotropic. `None` if the texture's own sampler
    /// asks for no mipmaps.
    fn sampler_of(&self, sampler: &gltf::texture::Sampler<'_>) -> Option<ImageSamplerDescriptor> {
        let mut out = self.sampler.clone();
        if self.overrides {
            return Some(out);
        }
        let mode = |mode| match mode {
            WrappingMode::ClampToEdge => ImageAddressMode::ClampToEdge,
            WrappingMode::MirroredRepeat => ImageAddressMode::MirrorRepeat,
            WrappingMode::Repeat => ImageAddressMode::Repeat,
        };
        (out.address_mode_u, out.address_mode_v) = (mode(sampler.wrap_s()), mode(sampler.wrap_t()));
        // Textures that say nothing look as the game's default wants; pixel art stays what it is.
        let is_smooth = match sampler.min_filter() {
            Some(filter) => filter == MinFilter::LinearMipmapLinear,
            None => out.min_filter == ImageFilterMode::Linear,
        };
        let is_smooth = is_smooth && sampler.mag_filter() != Some(MagFilter::Nearest);
        // Anisotropic filters are trilinear. A game's own anisotropy stays.
        if out.anisotropy_clamp == 1 {
            out.set_anisotropic_filter(self.anisotropy);
        }
        is_smooth.then_some(out)
    }
}

/// The content of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Content {
    /// Colours, sRGB encoded.
    Colour,
    /// Colours, cut out where alpha is below this value. Mipmaps keep the fraction of texels above it.
    CutOut(f32),
    /// Unit vectors.
    Normals,
    /// Linear numbers.
    Data,
}

/// The textures of a material.
pub(super) fn textures<'a>(material: &gltf::Material<'a>) -> Vec<(gltf::Texture<'a>, Content)> {
    let colour = match material.alpha_mode() {
        AlphaMode::Mask => Content::CutOut(material.alpha_cutoff().unwrap_or(0.5)),
        AlphaMode::Opaque | AlphaMode::Blend => Content::Colour,
    };
    let pbr = material.pbr_metallic_roughness();
    let all = [
        (pbr.base_color_texture().map(|info| info.texture()), colour),
        (material.emissive_texture().map(|info| info.texture()), Content::Colour),
        (material.normal_texture().map(|normal| normal.texture()), Content::Normals),
        (pbr.metallic_roughness_texture().map(|info| info.texture()), Content::Data),
        (material.occlusion_texture().map(|occlusion| occlusion.texture()), Content::Data),
    ];
    all.into_iter().filter_map(|(texture, content)| Some((texture?, content))).collect()
}

impl Content {
    fn is_colour(self) -> bool {
        matches!(self, Self::Colour | Self::CutOut(_))
    }

    /// The value of a texel, in a form that can be averaged.
    fn read(self, texel: [u8; 4]) -> Vec4 {
        let [r, g, b, a] = texel.map(|byte| f32::from(byte) / 255.0);
        match self {
            Self::Colour | Self::CutOut(_) => {
                let [r, g, b, _] = texel.map(|byte| LIGHT_OF_BYTE[usize::from(byte)]);
                (a.max(LEAST_ALPHA) * Vec3::new(r, g, b)).extend(a.max(LEAST_ALPHA))
            }
            Self::Normals => (2.0 * Vec3::new(r, g, b) - 1.0).extend(a),
            Self::Data => Vec4::new(r, g, b, a),
        }
    }

    /// The texel of a mean value, with its alpha times `alpha`.
    fn write(self, mean: Vec4, alpha: f32) -> [u8; 4] {
        let (rgb, a) = (mean.truncate(), mean.w);
        match self {
            Self::Colour | Self::CutOut(_) => {
                let light = (rgb / a).clamp(Vec3::ZERO, Vec3::ONE) * LIGHT_STEPS as f32;
                let [r, g, b] = light.to_array().map(|x| BYTE_OF_LIGHT[x.round() as usize]);
                [r, g, b, if a > LEAST_ALPHA { to_byte((alpha * a).min(1.0)) } else { 0 }]
            }
            Self::Normals => (0.5 * rgb.normalize_or(Vec3::Z) + 0.5).extend(a).to_array().map(to_byte),
            Self::Data => mean.to_array().map(to_byte),
        }
    }
}

fn to_byte(x: f32) -> u8 {
    (255.0 * x).round() as u8
}

/// The image with all its mipmaps. `None` if it already has some, or does not have four bytes a texel.
fn with_mipmaps(mut image: Image, content: Content) -> Option<Image> {
    let mut size = image.size();
    let data = image.data.as_mut()?;
    if image.texture_descriptor.mip_level_count > 1 || data.len() != 4 * size.element_product() as usize {
        return None;
    }
    let (texels, _) = data.as_chunks::<4>();
    let kept = |least| texels.iter().filter(|texel| f32::from(texel[3]) >= 255.0 * least).count();
    let cut_out = match content {
        Content::CutOut(least) => Some((least, kept(least) as f32 / texels.len() as f32)),
        _ => None,
    };
    let mut mipmap = (size.max_element() > 1).then(|| half_resolution(size, |i| content.read(texels[i])));
    while let Some(texels) = mipmap {
        size = half(size);
        let alpha = cut_out.map_or(1.0, |(least, fraction)| alpha_that_keeps(fraction, least, &texels));
        data.extend(texels.iter().flat_map(|&texel| content.write(texel, alpha)));
        image.texture_descriptor.mip_level_count += 1;
        mipmap = (size.max_element() > 1).then(|| half_resolution(size, |i| texels[i]));
    }
    Some(image)
}

fn half(size: UVec2) -> UVec2 {
    (size / 2).max(UVec2::ONE)
}

/// Means of 2 x 2 texels, or of two texels where an image is one texel wide or high.
fn half_resolution(size: UVec2, texel: impl Fn(usize) -> Vec4) -> Vec<Vec4> {
    let half = half(size);
    let at = |x: u32, y: u32| texel((y.min(size.y - 1) * size.x + x.min(size.x - 1)) as usize);
    let mean = |x: u32, y: u32| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
    (0..half.y).flat_map(|y| (0..half.x).map(move |x| (x, y))).map(|(x, y)| mean(2 * x, 2 * y)).collect()
}

/// Factor on the alpha of a mipmap with which this fraction of its texels reaches `least`. At least one, because a
/// larger cut-out is not seen.
fn alpha_that_keeps(fraction: f32, least: f32, texels: &[Vec4]) -> f32 {
    let mut alphas: Vec<f32> = texels.iter().map(|texel| texel.w).collect();
    let count = (fraction * alphas.len() as f32).round() as usize;
    if count == 0 {
        return 1.0;
    }
    let (_, &mut last, _) = alphas.select_nth_unstable_by(count - 1, |a, b| b.total_cmp(a));
    // Up to the next byte, so that rounding does not remove it again.
    (((255.0 * least).floor() + 1.0) / 255.0 / last).max(1.0)
}

#[cfg(test)]
mod tests {
    use bevy::image::TextureFormatPixelInfo;

    use super::*;

    /// The mipmaps of a square of these texels, the largest first.
    fn mipmaps(content: Content, side: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<Vec<[u8; 4]>> {
        let mut image = Image::default();
        image.texture_descriptor.size.width = side;
        image.texture_descriptor.size.height = side;
        let places = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
        image.data = Some(places.flat_map(|(x, y)| texel(x, y)).collect());
        assert_eq!(image.texture_descriptor.format.pixel_size().ok(), Some(4));
        let image = with_mipmaps(image, content).expect("four bytes a texel");
        assert_eq!(image.texture_descriptor.mip_level_count, side.ilog2() + 1);
        let data = image.data.expect("data");
        let mut left = data.as_chunks::<4>().0;
        let mut all = Vec::new();
        for level in 0..=side.ilog2() {
            let (mipmap, rest) = left.split_at((side >> level).pow(2) as usize);
            all.push(mipmap.to_vec());
            left = rest;
        }
        assert!(left.is_empty());
        all
    }

    fn checkers(x: u32, y: u32, [a, b]: [[u8; 4]; 2]) -> [u8; 4] {
        if (x + y).is_multiple_of(2) { a } else { b }
    }

    #[test]
    fn every_colour_stays_what_it_is() {
        for byte in 0..=255 {
            let colour = [byte, 255 - byte, 7, 255];
            for mipmap in mipmaps(Content::Colour, 4, |_, _| colour) {
                assert!(mipmap.iter().all(|texel| *texel == colour), "{mipmap:?}");
            }
        }
    }

    #[test]
    fn colours_are_averaged_in_linear_light_and_data_is_not() {
        let black_and_white = |x, y| checkers(x, y, [[0, 0, 0, 255], [255; 4]]);
        // Half of the light is this in sRGB.
        assert_eq!(mipmaps(Content::Colour, 4, black_and_white)[1], [[188, 188, 188, 255]; 4]);
        assert_eq!(mipmaps(Content::Data, 4, black_and_white)[2], [[128, 128, 128, 255]]);
    }

    #[test]
    fn what_is_transparent_lends_no_colour() {
        let red_on_nothing = |x, y| checkers(x, y, [[200, 0, 0, 255], [0, 255, 0, 0]]);
        let [r, g, b, a] = mipmaps(Content::Colour, 2, red_on_nothing)[1][0];
        assert!(r > 195 && g < 20 && (b, a) == (0, 128), "{:?}", [r, g, b, a]);
    }

    #[test]
    fn normals_keep_their_length() {
        // Two that lean to either side, 45 degrees each.
        let leaning = |x, y| checkers(x, y, [[218, 128, 218, 255], [38, 128, 218, 255]]);
        let [x, y, z, _] = mipmaps(Content::Normals, 2, leaning)[1][0];
        assert!(x.abs_diff(128) <= 1 && y.abs_diff(128) <= 1 && z >= 254, "{:?}", [x, y, z]);
    }

    #[test]
    fn as_much_of_a_cut_out_stays() {
        // Blades of grass: a quarter of each row.
        let blades = |x: u32, _: u32| [90, 160, 40, if x.is_multiple_of(4) { 255 } else { 0 }];
        let all = mipmaps(Content::CutOut(0.5), 64, blades);
        for mipmap in &all[..5] {
            let kept = mipmap.iter().filter(|texel| texel[3] >= 128).count() as f32 / mipmap.len() as f32;
            assert!(kept >= 0.25, "{kept} of {} texels", mipmap.len());
        }
        // As colours that blend they would disappear.
        assert!(mipmaps(Content::Colour, 64, blades)[2].iter().all(|texel| texel[3] == 64));
    }
}
