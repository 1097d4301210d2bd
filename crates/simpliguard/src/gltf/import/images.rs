//! Decoding of the images that the used materials refer to.

use std::io::Cursor;

use bytes::Bytes;
use image::{DynamicImage, ImageDecoder as _, ImageFormat, ImageReader, RgbaImage};
use rayon::prelude::*;

use super::accessor::Reader;
use super::extensions;
use super::material::TextureUse;
use super::resources::{SourceImage, mime_of, resource_error};
use crate::data::Texture;
use crate::{Error, StageId};

/// The largest side of an image in texels.
pub(super) const LONGEST_SIDE: u32 = 32_768;

/// An encoded image whose header was read.
struct Encoded {
    image: usize,
    bytes: Bytes,
    format: ImageFormat,
    /// Its name in messages.
    label: String,
    external: bool,
}

/// Decodes every used image once, in parallel, and makes one texture for each of `uses`, in their order.
pub(super) fn decode(reader: Reader<'_>, external: &[SourceImage], uses: &[TextureUse]) -> Result<Vec<Texture>, Error> {
    let mut images: Vec<usize> = uses.iter().map(|texture| texture.image).collect();
    images.sort_unstable();
    images.dedup();
    let encoded = images.into_iter().map(|image| encoded(reader, external, image)).collect::<Result<Vec<_>, _>>()?;
    let mut texels = 0u64;
    for image in &encoded {
        texels = texels.saturating_add(texel_count(reader, image)?);
        reader.asset.within("the number of texels of its textures", texels as usize, reader.asset.limits.texels)?;
    }
    let decoded: Vec<Result<Vec<(usize, Texture)>, Error>> = encoded
        .par_iter()
        .map(|image| {
            reader.asset.check()?;
            let pixels = pixels(reader, image)?;
            reader.asset.check()?;
            let of_image = uses.iter().enumerate().filter(|(_, texture)| texture.image == image.image);
            Ok(of_image.map(|(k, texture)| (k, Texture::new(&pixels, texture.wrap_modes(), texture.srgb))).collect())
        })
        .collect();
    let mut textures = Vec::with_capacity(uses.len());
    for of_image in decoded {
        textures.extend(of_image?);
    }
    textures.sort_by_key(|(k, _)| *k);
    Ok(textures.into_iter().map(|(_, texture)| texture).collect())
}

fn encoded(reader: Reader<'_>, external: &[SourceImage], image: usize) -> Result<Encoded, Error> {
    let (bytes, label, is_external) = match external.get(image) {
        Some(SourceImage::Failed { uri, reason }) => return Err(resource_error(reader.asset, uri, reason.clone())),
        Some(SourceImage::Undecodable { reason }) => return Err(undecodable_ktx2(reader, image, reason)),
        Some(SourceImage::Read { uri, bytes, .. }) => (bytes.clone(), format!("'{uri}'"), true),
        _ => {
            let Some(view) = reader.root.images[image].buffer_view else {
                return Err(reader.asset.invalid(format!("image {image} has neither a URI nor a buffer view")));
            };
            (reader.view_bytes(view)?, format!("image {image}"), false)
        }
    };
    let format = match mime_of(&bytes) {
        Some("image/png") => ImageFormat::Png,
        Some("image/jpeg") => ImageFormat::Jpeg,
        Some("image/webp") => ImageFormat::WebP,
        Some("image/vnd-ms.dds") => return Err(extensions::refuse(reader.asset, "MSFT_texture_dds")),
        _ => return Err(reader.asset.invalid(format!("{label} is no PNG, JPEG or WebP image"))),
    };
    Ok(Encoded { image, bytes, format, label, external: is_external })
}

fn undecodable_ktx2(reader: Reader<'_>, image: usize, reason: &str) -> Error {
    let found = format!("image {image} cannot be decoded: {reason}");
    let advice =
        "decode its textures with 'gltf-transform ktxdecompress in.glb out.glb', or export it with PNG textures";
    Error::invalid(reader.asset.name, StageId::Import, found, advice)
}

/// Width times height, from the image's header.
fn texel_count(reader: Reader<'_>, encoded: &Encoded) -> Result<u64, Error> {
    // Enough for metadata in front of the pixels. The pixels themselves are not decoded here.
    const HEADER_BYTES: u64 = 64 << 20;
    let decoder = open(encoded, HEADER_BYTES).into_decoder().map_err(|error| undecodable(reader, encoded, &error))?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(reader.asset.invalid(format!("{} has no texels", encoded.label)));
    }
    Ok(u64::from(width) * u64::from(height))
}

/// The image as 8 bit RGBA.
fn pixels(reader: Reader<'_>, encoded: &Encoded) -> Result<RgbaImage, Error> {
    // Up to 16 bytes for each texel: four channels of 32 bits.
    let most_bytes = reader.asset.limits.texels.saturating_mul(16);
    open(encoded, most_bytes)
        .into_decoder()
        .and_then(DynamicImage::from_decoder)
        .map(DynamicImage::into_rgba8)
        .map_err(|error| undecodable(reader, encoded, &error))
}

fn open(encoded: &Encoded, most_bytes: u64) -> ImageReader<Cursor<&[u8]>> {
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(most_bytes);
    limits.max_image_width = Some(LONGEST_SIDE);
    limits.max_image_height = Some(LONGEST_SIDE);
    let mut reader = ImageReader::with_format(Cursor::new(&encoded.bytes[..]), encoded.format);
    reader.limits(limits);
    reader
}

fn undecodable(reader: Reader<'_>, encoded: &Encoded, error: &image::ImageError) -> Error {
    let reason = format!("it cannot be decoded: {error}");
    if encoded.external {
        resource_error(reader.asset, encoded.label.trim_matches('\''), reason)
    } else {
        reader.asset.invalid(format!("{}: {reason}", encoded.label))
    }
}
