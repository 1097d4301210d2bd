//! Images that were decoded, as PNG.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, RgbaImage};

/// Deflate level of the PNGs, as for those of the levels.
const PNG_LEVEL: u8 = 3;

/// The PNG of an image, without its alpha channel if that shows nothing.
pub(super) fn png(image: &RgbaImage) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Level(PNG_LEVEL), FilterType::Adaptive);
    let written = if image.pixels().all(|texel| texel.0[3] == u8::MAX) {
        let rgb: Vec<u8> = image.pixels().flat_map(|texel| [texel.0[0], texel.0[1], texel.0[2]]).collect();
        encoder.write_image(&rgb, image.width(), image.height(), ExtendedColorType::Rgb8)
    } else {
        encoder.write_image(image, image.width(), image.height(), ExtendedColorType::Rgba8)
    };
    written.map(|()| bytes).map_err(|error| format!("it cannot be written as PNG: {error}"))
}
