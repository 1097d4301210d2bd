//! Images as files that are small.

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType as PngFilter, PngEncoder};
use image::imageops::{FilterType, resize};
use image::{DynamicImage, RgbImage, RgbaImage};

/// An image whose longer side is `side` pixels at most. Smaller ones stay as they are.
pub fn at_most(image: RgbaImage, side: u32) -> RgbaImage {
    let (width, height) = image.dimensions();
    let longest = width.max(height);
    if longest <= side {
        return image;
    }
    let scaled = |length: u32| (u64::from(length) * u64::from(side) / u64::from(longest)).max(1) as u32;
    resize(&image, scaled(width), scaled(height), FilterType::Triangle)
}

/// An image file and its MIME type, with a longer side of `side` pixels at most: JPEG of a quality from 1 to 100 if the image is
/// opaque, else PNG. `None` if it cannot be encoded.
pub fn encode(image: &RgbaImage, side: u32, quality: u8) -> Option<(Vec<u8>, &'static str)> {
    let image = at_most(image.clone(), side);
    if image.pixels().all(|pixel| pixel[3] == u8::MAX) {
        return Some((jpeg(&DynamicImage::ImageRgba8(image).to_rgb8(), quality)?, "image/jpeg"));
    }
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, PngFilter::Adaptive);
    image.write_with_encoder(encoder).ok()?;
    Some((bytes, "image/png"))
}

/// A JPEG of a quality from 1 to 100; `None` if the image is too large for one.
pub fn jpeg(image: &RgbImage, quality: u8) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    image.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, quality)).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use image::Rgba;

    use super::*;

    #[test]
    fn opaque_images_become_jpeg_and_others_png() {
        for (alpha, mime) in [(255, "image/jpeg"), (100, "image/png")] {
            let image = RgbaImage::from_pixel(128, 64, Rgba([9, 90, 200, alpha]));
            let (bytes, found) = encode(&image, 32, 80).expect("encodes");
            let size = image::load_from_memory(&bytes).expect("an image");
            assert_eq!((found, size.width(), size.height()), (mime, 32, 16));
        }
    }

    #[test]
    fn small_and_narrow_images_keep_a_pixel() {
        assert_eq!(at_most(RgbaImage::new(8, 4), 8).dimensions(), (8, 4));
        assert_eq!(at_most(RgbaImage::new(4000, 1), 10).dimensions(), (10, 1));
        assert_eq!(at_most(RgbaImage::new(0, 0), 10).dimensions(), (0, 0));
    }
}
