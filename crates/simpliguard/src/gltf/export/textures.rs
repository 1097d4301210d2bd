//! The textures of a level as image files.

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError, RgbImage};
use serde_json::json;

use super::builder::{BufferTarget, Builder, Kind};
use super::fault::fault;
use crate::data::{LevelTextures, TextureFormat};
use crate::{Cancellation, Error};

/// Deflate level of the PNGs: within 8 % of the size of level 6 in a fifth of its time.
const PNG_LEVEL: u8 = 3;

/// The image files of a level.
pub(in crate::gltf) struct EncodedTextures {
    base_color: Option<EncodedImage>,
    normal: Option<EncodedImage>,
    occlusion_roughness_metallic: Option<EncodedImage>,
    emissive: Option<EncodedImage>,
}

/// An image file.
struct EncodedImage {
    bytes: Vec<u8>,
    mime: &'static str,
}

/// The glTF textures of a level, by index.
pub(in crate::gltf) struct WrittenTextures {
    pub(super) base_color: Option<usize>,
    pub(super) normal: Option<usize>,
    pub(super) occlusion_roughness_metallic: Option<usize>,
    pub(super) emissive: Option<usize>,
}

impl EncodedTextures {
    /// Encodes the textures in parallel. The alpha of the base colour is left out unless some material shows it.
    pub(in crate::gltf) fn new(
        asset: &str,
        textures: &LevelTextures,
        has_alpha: bool,
        cancellation: &Cancellation,
    ) -> Result<Self, Error> {
        let encode = |image: &Option<RgbImage>, format| {
            cancellation.check(asset)?;
            image.as_ref().map(|image| encode(asset, image, image.dimensions(), format)).transpose()
        };
        // Blocks of JPEG, which are invisible in colours, would show in the shading.
        let data = |image| encode(image, TextureFormat::Png);
        let ((base_color, normal), (packed, emissive)) = rayon::join(
            || {
                let base_color = || encode_base_color(asset, textures, has_alpha);
                rayon::join(base_color, || data(&textures.normal))
            },
            || {
                let emissive = || encode(&textures.emissive, textures.format);
                rayon::join(|| data(&textures.occlusion_roughness_metallic), emissive)
            },
        );
        Ok(Self {
            base_color: base_color?,
            normal: normal?,
            occlusion_roughness_metallic: packed?,
            emissive: emissive?,
        })
    }

    /// Appends images and textures.
    pub(in crate::gltf) fn write(&self, out: &mut Builder, sampler: usize) -> WrittenTextures {
        let mut texture = |image: &EncodedImage| {
            let view = out.push_view(&image.bytes, BufferTarget::None);
            let image = out.push(Kind::Image, json!({ "bufferView": view, "mimeType": image.mime }));
            out.push(Kind::Texture, json!({ "source": image, "sampler": sampler }))
        };
        WrittenTextures {
            base_color: self.base_color.as_ref().map(&mut texture),
            normal: self.normal.as_ref().map(&mut texture),
            occlusion_roughness_metallic: self.occlusion_roughness_metallic.as_ref().map(&mut texture),
            emissive: self.emissive.as_ref().map(&mut texture),
        }
    }
}

/// Appends the sampler of all level textures: trilinear, clamped.
pub(in crate::gltf) fn push_sampler(out: &mut Builder) -> usize {
    out.push(Kind::Sampler, json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 }))
}

/// The base colour, without the alpha channel if nothing shows it.
fn encode_base_color(asset: &str, textures: &LevelTextures, has_alpha: bool) -> Result<Option<EncodedImage>, Error> {
    let Some(image) = &textures.base_color else { return Ok(None) };
    if !has_alpha || image.pixels().all(|p| p.0[3] == 255) {
        let rgb: Vec<u8> = image.pixels().flat_map(|p| [p.0[0], p.0[1], p.0[2]]).collect();
        encode(asset, &rgb, image.dimensions(), textures.format).map(Some)
    } else {
        png(asset, image, image.dimensions(), ExtendedColorType::Rgba8).map(Some)
    }
}

/// An image file of RGB texels.
fn encode(asset: &str, texels: &[u8], size: (u32, u32), format: TextureFormat) -> Result<EncodedImage, Error> {
    match format {
        TextureFormat::Png => png(asset, texels, size, ExtendedColorType::Rgb8),
        TextureFormat::Jpeg(quality) => {
            let mut bytes = Vec::new();
            JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100) as u8)
                .write_image(texels, size.0, size.1, ExtendedColorType::Rgb8)
                .map_err(|e| unencodable(asset, size, &e))?;
            Ok(EncodedImage { bytes, mime: "image/jpeg" })
        }
    }
}

fn png(asset: &str, texels: &[u8], size: (u32, u32), color: ExtendedColorType) -> Result<EncodedImage, Error> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Level(PNG_LEVEL), FilterType::Adaptive)
        .write_image(texels, size.0, size.1, color)
        .map_err(|e| unencodable(asset, size, &e))?;
    Ok(EncodedImage { bytes, mime: "image/png" })
}

fn unencodable(asset: &str, (width, height): (u32, u32), error: &ImageError) -> Error {
    fault(asset, format!("a texture of {width}x{height} texels cannot be encoded: {error}"))
}
