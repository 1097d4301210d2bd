//! Images of models.

use std::io::Cursor;

use image::ImageReader;

/// Width and height of an image, from its header.
pub(crate) fn size_of_image(bytes: &[u8]) -> Option<[u32; 2]> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?;
    let (width, height) = reader.into_dimensions().ok()?;
    Some([width, height])
}
