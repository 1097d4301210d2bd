//! Images of a glTF at a smaller size.

use std::io::Cursor;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType as PngFilter, PngEncoder};
use image::imageops::{FilterType, resize};
use image::{DynamicImage, ImageReader, RgbImage, RgbaImage};
use serde_json::Value;
use simpliguard::data::Document;

use crate::inspect::document::index;

/// Largest side in texels of any image that is made anew.
const LARGEST: u32 = 1024;

/// An image as it is, and its texels.
pub(super) struct Picture {
    bytes: Vec<u8>,
    mime: &'static str,
    /// Width and height of the image as it is.
    size: [u32; 2],
    /// The texels, at [`LARGEST`] at most.
    texels: RgbaImage,
    is_opaque: bool,
}

/// Size and encoding of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Encoding {
    /// Longest side in texels.
    pub(super) side: u32,
    /// Quality of JPEG, 1 to 100.
    pub(super) quality: u8,
}

impl Picture {
    /// Reads an image; `None` if it cannot be read.
    pub(super) fn read(document: &Document, image: usize) -> Option<Self> {
        let bytes = match document.images.get(image).and_then(Option::as_ref) {
            Some((bytes, _)) => bytes.to_vec(),
            None => inside(document, document.json.get("images")?.get(image)?)?.to_vec(),
        };
        let reader = ImageReader::new(Cursor::new(&bytes)).with_guessed_format().ok()?;
        let mime = reader.format()?.to_mime_type();
        let decoded = reader.decode().ok()?;
        let size = [decoded.width(), decoded.height()];
        let decoded = if size.iter().any(|&side| side > LARGEST) {
            decoded.resize(LARGEST, LARGEST, FilterType::Triangle)
        } else {
            decoded
        };
        let texels = decoded.to_rgba8();
        let is_opaque = texels.pixels().all(|pixel| pixel[3] == u8::MAX);
        Some(Self { bytes, mime, size, texels, is_opaque })
    }

    /// The bytes of an image file, and its MIME type. Without an encoding, or if that takes no less, as it is.
    pub(super) fn encoded(&self, encoding: Option<Encoding>) -> (Vec<u8>, &'static str) {
        let as_it_is = || (self.bytes.clone(), self.mime);
        let Some(encoding) = encoding else { return as_it_is() };
        let made = self.made(encoding);
        let fits = self.size.iter().all(|&side| side <= encoding.side);
        made.filter(|(bytes, _)| !fits || bytes.len() < self.bytes.len()).unwrap_or_else(as_it_is)
    }

    fn made(&self, Encoding { side, quality }: Encoding) -> Option<(Vec<u8>, &'static str)> {
        let (width, height) = self.texels.dimensions();
        let longest = width.max(height);
        let scaled =
            |length: u32| (u64::from(length) * u64::from(side.min(longest)) / u64::from(longest.max(1))).max(1);
        let (new_width, new_height) = (scaled(width) as u32, scaled(height) as u32);
        let smaller = (longest > side).then(|| resize(&self.texels, new_width, new_height, FilterType::Triangle));
        let texels = smaller.as_ref().unwrap_or(&self.texels);
        if self.is_opaque {
            return Some((jpeg(&DynamicImage::ImageRgba8(texels.clone()).to_rgb8(), quality)?, "image/jpeg"));
        }
        let mut bytes = Vec::new();
        let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, PngFilter::Adaptive);
        texels.write_with_encoder(encoder).ok()?;
        Some((bytes, "image/png"))
    }
}

/// A JPEG; `None` if it is too large for one.
pub(in crate::report) fn jpeg(image: &RgbImage, quality: u8) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    image.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, quality)).ok()?;
    Some(bytes)
}

/// The bytes of an image in a buffer view.
fn inside<'d>(document: &'d Document, image: &Value) -> Option<&'d [u8]> {
    let view = document.json.get("bufferViews")?.get(index(image, "bufferView")?)?;
    let start = index(view, "byteOffset").unwrap_or(0);
    document.buffers.get(index(view, "buffer")?)?.get(start..start.checked_add(index(view, "byteLength")?)?)
}

#[cfg(test)]
mod tests {
    use image::{ImageFormat, Rgba};

    use super::*;

    fn picture(size: [u32; 2], alpha: u8) -> Picture {
        let noise = |x: u32, y: u32| (x * 7919 + y * 104_729) as u8;
        let image = RgbaImage::from_fn(size[0], size[1], |x, y| Rgba([noise(x, y), noise(y, x), 0, alpha]));
        let mut png = Cursor::new(Vec::new());
        image.write_to(&mut png, ImageFormat::Png).expect("encodes");
        let document = Document { images: vec![Some((png.into_inner().into(), "image/png"))], ..Document::default() };
        Picture::read(&document, 0).expect("an image")
    }

    fn decoded(bytes: &[u8]) -> DynamicImage {
        image::load_from_memory(bytes).expect("an image")
    }

    #[test]
    fn opaque_images_become_jpeg_and_others_stay_png() {
        let small = Some(Encoding { side: 32, quality: 80 });
        for (alpha, mime) in [(255, "image/jpeg"), (100, "image/png")] {
            let (bytes, found) = picture([128, 64], alpha).encoded(small);
            assert_eq!((found, decoded(&bytes).width(), decoded(&bytes).height()), (mime, 32, 16));
        }
    }

    #[test]
    fn images_that_fit_are_left_alone() {
        let picture = picture([8, 1], 255);
        assert_eq!(picture.encoded(None), (picture.bytes.clone(), "image/png"));
        assert_eq!(picture.encoded(Some(Encoding { side: 8, quality: 100 })).1, "image/png");
        assert!(Picture::read(&Document::default(), 0).is_none());
    }
}
