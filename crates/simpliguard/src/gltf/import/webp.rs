//! WebP images.

use image::{ImageFormat, RgbaImage};

use super::images;

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
        let (sides, _) = images::header(bytes, ImageFormat::WebP).ok()?;
        let is_sound = sides.iter().all(|side| (1..=longest).contains(side));
        is_sound.then(|| Self { bytes, texel_count: sides.map(u64::from).iter().product() })
    }

    /// Width times height.
    pub(super) fn texel_count(&self) -> u64 {
        self.texel_count
    }

    /// Decodes the image, of an animation the first one. `None` if it is broken.
    pub(super) fn decode(&self) -> Option<RgbaImage> {
        images::rgba(self.bytes, ImageFormat::WebP, self.texel_count * DECODING_BYTES).ok()
    }
}
