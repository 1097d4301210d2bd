//! Decoding of the images that the used materials refer to.

use std::io::Cursor;

use bytes::Bytes;
use image::{DynamicImage, ImageDecoder as _, ImageFormat, ImageReader, ImageResult, RgbaImage};
use rayon::prelude::*;

use super::accessor::Reader;
use super::extensions;
use super::material::TextureUse;
use super::resources::{SourceImage, mime_of, resource_error};
use crate::data::Texture;
use crate::{Error, StageId};

/// Most memory for the metadata in front of the pixels, in bytes.
const HEADER_BYTES: u64 = 64 << 20;
/// The largest side of an image in texels: no graphics card takes more.
pub(super) const LONGEST_SIDE: u32 = 16_384;

/// Images that are decoded at the same time, as an estimate.
pub(super) const AT_ONCE: usize = 8;
/// Bytes of three texels of a texture with its mip chain.
const THREE_TEXELS: u64 = 16;
/// Bytes of a texel as RGBA.
const RGBA: u64 = 4;

/// An encoded image whose header was read.
pub(super) struct Encoded {
    image: usize,
    bytes: Bytes,
    format: ImageFormat,
    /// Its name in messages.
    label: String,
    external: bool,
    texels: u64,
    /// Bytes of a texel as it is stored, uncompressed.
    stored: u64,
}

/// The images of `uses`, each once, after their headers were checked against the limits.
///
/// # Errors
/// Those of the images; [`Error::Limit`] and [`Error::Memory`] if they are too large.
pub(super) fn find(reader: Reader<'_>, external: &[SourceImage], uses: &[TextureUse]) -> Result<Vec<Encoded>, Error> {
    let mut variants: Vec<(usize, bool)> = uses.iter().map(|texture| (texture.image, texture.srgb)).collect();
    variants.sort_unstable();
    variants.dedup();
    let (mut out, mut texels, mut kept) = (Vec::new(), 0u64, 0u64);
    for of_image in variants.chunk_by(|a, b| a.0 == b.0) {
        let image = encoded(reader, external, of_image[0].0)?;
        texels = texels.saturating_add(image.texels);
        reader.asset.within("the number of texels of its textures", texels as usize, reader.asset.limits.texels)?;
        kept = kept.saturating_add(image.texels.saturating_mul(THREE_TEXELS * of_image.len() as u64) / 3);
        out.push(image);
    }
    let mut decoding: Vec<u64> = out.iter().map(Encoded::decoding_bytes).collect();
    decoding.sort_unstable_by(|a, b| b.cmp(a));
    reader.asset.allocate("its textures", kept)?;
    reader.asset.fits("the decoding of its textures", decoding.iter().take(AT_ONCE).sum())?;
    Ok(out)
}

/// Decodes every image once, in parallel, and makes one texture for each of `uses`, in their order.
pub(super) fn decode(reader: Reader<'_>, images: &[Encoded], uses: &[TextureUse]) -> Result<Vec<Texture>, Error> {
    let decoded: Vec<Result<Vec<(usize, Texture)>, Error>> = images
        .par_iter()
        .map(|image| {
            reader.asset.check()?;
            let pixels = pixels(reader, image)?;
            reader.asset.check()?;
            Ok(textures_of(&pixels, image.image, uses))
        })
        .collect();
    let mut textures = Vec::with_capacity(uses.len());
    for of_image in decoded {
        textures.extend(of_image?);
    }
    textures.sort_by_key(|(k, _)| *k);
    Ok(textures.into_iter().map(|(_, texture)| texture).collect())
}

/// The textures that show one image, each with its place among `uses`. They share their texels.
fn textures_of(pixels: &RgbaImage, image: usize, uses: &[TextureUse]) -> Vec<(usize, Texture)> {
    let mut made: [Option<Texture>; 2] = [None, None];
    let of_image = uses.iter().enumerate().filter(|(_, texture)| texture.image == image);
    of_image
        .map(|(k, texture)| {
            let same = &mut made[usize::from(texture.srgb)];
            let shared = same.get_or_insert_with(|| Texture::new(pixels, texture.wrap, texture.srgb));
            (k, shared.wrapped(texture.wrap))
        })
        .collect()
}

impl Encoded {
    /// Bytes while it is decoded.
    fn decoding_bytes(&self) -> u64 {
        self.texels.saturating_mul(self.stored + RGBA)
    }
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
    let mut out = Encoded { image, bytes, format, label, external: is_external, texels: 0, stored: 0 };
    (out.texels, out.stored) = size(reader, &out)?;
    Ok(out)
}

fn undecodable_ktx2(reader: Reader<'_>, image: usize, reason: &str) -> Error {
    let found = format!("image {image} cannot be decoded: {reason}");
    let advice =
        "decode its textures with 'gltf-transform ktxdecompress in.glb out.glb', or export it with PNG textures";
    Error::invalid(reader.asset.name, StageId::Import, found, advice)
}

/// Width times height, and the bytes of a stored texel, from the image's header.
fn size(reader: Reader<'_>, encoded: &Encoded) -> Result<(u64, u64), Error> {
    let (sides, stored) =
        header(&encoded.bytes, encoded.format).map_err(|error| undecodable(reader, encoded, &error))?;
    let [width, height] = sides;
    if width == 0 || height == 0 {
        return Err(reader.asset.invalid(format!("{} has no texels", encoded.label)));
    }
    let side = format!("the longer side of {} in texels", encoded.label);
    reader.asset.within(&side, width.max(height) as usize, LONGEST_SIDE.into())?;
    Ok((u64::from(width) * u64::from(height), stored))
}

fn pixels(reader: Reader<'_>, encoded: &Encoded) -> Result<RgbaImage, Error> {
    rgba(&encoded.bytes, encoded.format, encoded.decoding_bytes()).map_err(|error| undecodable(reader, encoded, &error))
}

/// Width, height, and the bytes of a stored texel, from the header of an image.
pub(super) fn header(bytes: &[u8], format: ImageFormat) -> ImageResult<([u32; 2], u64)> {
    let decoder = open(bytes, format, HEADER_BYTES).into_decoder()?;
    Ok((decoder.dimensions().into(), u64::from(decoder.color_type().bytes_per_pixel())))
}

/// An image as 8 bit RGBA. Decoding may take twice `decoding_bytes`, and its metadata besides.
pub(super) fn rgba(bytes: &[u8], format: ImageFormat, decoding_bytes: u64) -> ImageResult<RgbaImage> {
    let decoder = open(bytes, format, 2 * decoding_bytes + HEADER_BYTES).into_decoder()?;
    Ok(DynamicImage::from_decoder(decoder)?.into_rgba8())
}

/// A reader that takes no more memory than `most_bytes`.
fn open(bytes: &[u8], format: ImageFormat, most_bytes: u64) -> ImageReader<Cursor<&[u8]>> {
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(most_bytes);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
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
