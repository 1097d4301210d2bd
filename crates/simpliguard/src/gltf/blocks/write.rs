//! Writing of images in blocks.

use std::io::Cursor;

use bytes::Bytes;
use glam::UVec2;
use image::{ColorType, DynamicImage, ImageDecoder, ImageReader, RgbaImage};
use rayon::prelude::*;
use serde_json::{Value, json};
use simpliguard_texture::{
    BlockTexture, Content, ImageExtras, MipChain, Stamp, compress, mip_chain, mipmap_count, mipmap_size,
};

use super::contents::contents;
use crate::data::Document;
use crate::gltf::export::{embed, fault};
use crate::gltf::glb::{Chunks, split};
use crate::gltf::gpu_cost::encoded_image;
use crate::gltf::png::png;
use crate::gltf::rewrite::{Rewrite, ViewUse};
use crate::{Cancellation, Error};

/// Version of the encoder and of the form in a file.
pub const BLOCKS_VERSION: u32 = 1;

/// Longest side of the small image that other loaders show, in texels.
const SMALL_SIDE: u32 = 32;
/// Least ratio of the memory of texels to that of blocks. Small images lose it in the blocks of their last mipmaps.
const LEAST_GAIN: u64 = 3;

/// An image in blocks.
struct Compressed {
    image: usize,
    size: UVec2,
    is_colour: bool,
    /// Deflated.
    blocks: Vec<u8>,
    small: Vec<u8>,
}

/// A binary glTF of this program with its images in blocks, where these take at most a third of the memory. All other
/// parts of the document keep their indices and bytes. The same for any number of threads.
///
/// # Errors
/// [`Error::Cancelled`]; [`Error::Invalid`] if the bytes are no binary glTF; [`Error::Limit`] above 4 GiB.
pub fn compress_textures(asset: &str, glb: &[u8], cancellation: &Cancellation) -> Result<Vec<u8>, Error> {
    let broken = |_| fault(asset, "a baked file cannot be read");
    let Chunks { json, bin } = split(glb).map_err(|_| broken(()))?;
    let json: Value = serde_json::from_slice(json).map_err(|_| broken(()))?;
    let buffers = vec![Bytes::copy_from_slice(bin.unwrap_or_default())];
    let mut document = Document { json, buffers, ..Document::default() };
    let contents: Vec<(usize, Content)> = contents(&document.json).into_iter().collect();
    let compressed = contents.into_par_iter().map(|(image, content)| {
        cancellation.check(asset)?;
        Ok(compress_image(&document, image, content))
    });
    let compressed = compressed.collect::<Result<Vec<_>, Error>>()?;
    let compressed: Vec<Compressed> = compressed.into_iter().flatten().collect();
    if compressed.is_empty() {
        return Ok(glb.to_vec());
    }
    let mut rewrite = Rewrite::new(&mut document.json, &mut document.buffers);
    compressed.iter().for_each(|image| replace(&mut rewrite, image));
    rewrite.finish();
    embed(asset, &document)?.into_glb()
}

/// An image in blocks. `None` if it stays as it is.
fn compress_image(document: &Document, image: usize, content: Content) -> Option<Compressed> {
    let object = document.json.get("images")?.get(image)?;
    if object.get("extras").is_some_and(|extras| !extras.is_object()) {
        return None;
    }
    let decoder = ImageReader::new(Cursor::new(encoded_image(document, image)?)).with_guessed_format().ok()?;
    let decoder = decoder.into_decoder().ok()?;
    let size = UVec2::from(decoder.dimensions());
    // More bits are there for a reason.
    let has_bytes = matches!(decoder.color_type(), ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8);
    if !has_bytes || !BlockTexture::fits(size) {
        return None;
    }
    let texels = DynamicImage::from_decoder(decoder).ok()?.into_rgba8().into_raw();
    let chain = mip_chain(texels, size, content)?;
    let texture = BlockTexture { buffer_view: 0, width: size.x, height: size.y, srgb: content.is_colour() };
    if LEAST_GAIN * texture.gpu_bytes() > chain.texels.len() as u64 {
        return None;
    }
    let (blocks, small) = (compress(&chain)?, small_image(&chain)?);
    Some(Compressed { image, size, is_colour: content.is_colour(), blocks, small })
}

/// The first mipmap that is small, as PNG.
fn small_image(chain: &MipChain) -> Option<Vec<u8>> {
    let (mut start, mut number) = (0, 0);
    let bytes = |number| 4 * mipmap_size(chain.size, number).element_product() as usize;
    while mipmap_size(chain.size, number).max_element() > SMALL_SIDE && number + 1 < mipmap_count(chain.size) {
        start += bytes(number);
        number += 1;
    }
    let (texels, size) = (chain.texels.get(start..start + bytes(number))?, mipmap_size(chain.size, number));
    png(&RgbaImage::from_raw(size.x, size.y, texels.to_vec())?).ok()
}

/// Puts blocks and a small image in place of an image.
fn replace(rewrite: &mut Rewrite<'_>, compressed: &Compressed) {
    let buffer_view = rewrite.push_view(&compressed.blocks, ViewUse::Image);
    let object = &mut rewrite.list("images")[compressed.image];
    let old = object.get("bufferView").and_then(Value::as_u64).map(|view| view as usize);
    let small = match old {
        Some(view) => rewrite.replace_view(view, &compressed.small, ViewUse::Image),
        None => rewrite.push_view(&compressed.small, ViewUse::Image),
    };
    let UVec2 { x: width, y: height } = compressed.size;
    let bc7 = BlockTexture { buffer_view, width, height, srgb: compressed.is_colour };
    let extras = json!(ImageExtras { simpliguard: Stamp { bc7 } });
    let object = &mut rewrite.list("images")[compressed.image];
    object["bufferView"] = json!(small);
    object["mimeType"] = json!("image/png");
    object["extras"]["simpliguard"] = extras["simpliguard"].clone();
}
