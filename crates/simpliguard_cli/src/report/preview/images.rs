//! Images of a glTF at a smaller size.

use std::io::Cursor;

use image::{ImageReader, RgbaImage};
use serde_json::Value;
use simpliguard::data::Document;
use simpliguard_eval::{at_most, encode};

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
        Some(Self { bytes, mime, size, texels: at_most(decoded.to_rgba8(), LARGEST) })
    }

    /// The bytes of an image file, and its MIME type. Without an encoding, or if that takes no less, as it is.
    pub(super) fn encoded(&self, encoding: Option<Encoding>) -> (Vec<u8>, &'static str) {
        let as_it_is = || (self.bytes.clone(), self.mime);
        let Some(encoding) = encoding else { return as_it_is() };
        let made = encode(&self.texels, encoding.side, encoding.quality);
        let fits = self.size.iter().all(|&side| side <= encoding.side);
        made.filter(|(bytes, _)| !fits || bytes.len() < self.bytes.len()).unwrap_or_else(as_it_is)
    }
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

    #[test]
    fn images_are_made_anew_where_that_is_smaller() {
        let (bytes, mime) = picture([128, 64], 255).encoded(Some(Encoding { side: 32, quality: 80 }));
        let found = image::load_from_memory(&bytes).expect("an image");
        assert_eq!((mime, found.width(), found.height()), ("image/jpeg", 32, 16));
    }

    #[test]
    fn images_that_fit_are_left_alone() {
        let picture = picture([8, 1], 255);
        assert_eq!(picture.encoded(None), (picture.bytes.clone(), "image/png"));
        assert_eq!(picture.encoded(Some(Encoding { side: 8, quality: 100 })).1, "image/png");
        assert!(Picture::read(&Document::default(), 0).is_none());
    }
}
