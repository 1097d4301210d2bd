//! WebP images.

use std::io::Cursor;

use image::{DynamicImage, ImageDecoder as _, ImageFormat, ImageReader, RgbaImage};

use super::images::{self, HEADER_BYTES};

/// Bytes of a texel while an image is decoded: as it is stored, and as RGBA.
const DECODING_BYTES: u64 = 8;

/// A WebP image whose header was read.
pub(super) struct WebP<'a> {
    bytes: &'a [u8],
    texel_count: u64,
}

impl<'a> WebP<'a> {
    /// Reads the header of an image of 1 to `longest` texels a side. `None` if it is another one.
    pub(super) fn new(bytes: &'a [u8], longest: u32) -> Option<Self> {
        let [width, height]: [u32; 2] = open(bytes, HEADER_BYTES).into_decoder().ok()?.dimensions().into();
        let is_sound = [width, height].iter().all(|side| (1..=longest).contains(side));
        is_sound.then(|| Self { bytes, texel_count: u64::from(width) * u64::from(height) })
    }

    /// Width times height.
    pub(super) fn texel_count(&self) -> u64 {
        self.texel_count
    }

    /// Decodes the image, of an animation the first one. `None` if it is broken.
    pub(super) fn decode(&self) -> Option<RgbaImage> {
        let most_bytes = 2 * self.texel_count * DECODING_BYTES + HEADER_BYTES;
        let decoder = open(self.bytes, most_bytes).into_decoder().ok()?;
        Some(DynamicImage::from_decoder(decoder).ok()?.into_rgba8())
    }
}

fn open(bytes: &[u8], most_bytes: u64) -> ImageReader<Cursor<&[u8]>> {
    images::open(bytes, ImageFormat::WebP, most_bytes)
}
