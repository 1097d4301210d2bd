//! Images in blocks, as this program writes them into processed files. They become PNGs, so that the rest of the import
//! and the export see an ordinary glTF.

use std::collections::BTreeMap;

use bytes::Bytes;
use image::RgbaImage;
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};
use simpliguard_texture::{BlockTexture, ImageExtras};

use super::accessor::Reader;
use crate::Error;
use crate::gltf::png::png;
use crate::gltf::rewrite::{Rewrite, ViewUse};

/// A decoded image of the file.
pub(super) struct Decoded {
    image: usize,
    texture: BlockTexture,
    png: Vec<u8>,
}

/// Decodes the images in blocks, in parallel. `json` is the document that `reader` reads.
///
/// # Errors
/// [`Error::Limit`] if they have too many texels, [`Error::Invalid`] if their blocks are broken.
pub(super) fn decode(reader: Reader<'_>, json: &Value) -> Result<Vec<Decoded>, Error> {
    let images = json.get("images").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let extras = |image: &Value| ImageExtras::deserialize(image.get("extras")?).ok();
    let stamped = |(i, image): (usize, &Value)| Some((i, extras(image)?.simpliguard.bc7));
    let found: Vec<(usize, BlockTexture)> = images.iter().enumerate().filter_map(stamped).collect();
    let texels = found.iter().fold(0u64, |sum, (_, texture)| {
        sum.saturating_add(u64::from(texture.width).saturating_mul(texture.height.into()))
    });
    reader.asset.within("the number of texels of its textures", texels as usize, reader.asset.limits.texels)?;
    // Texels, their blocks, and the PNG.
    reader.asset.allocate("its images in blocks", texels.saturating_mul(10))?;
    found.into_par_iter().map(|(image, texture)| decode_image(reader, image, texture)).collect()
}

fn decode_image(reader: Reader<'_>, image: usize, texture: BlockTexture) -> Result<Decoded, Error> {
    reader.asset.check()?;
    let broken = || reader.asset.invalid(format!("image {image} has blocks that cannot be decoded"));
    let blocks = texture.inflate(&reader.view_bytes(texture.buffer_view)?).ok_or_else(broken)?;
    let texels = RgbaImage::from_raw(texture.width, texture.height, texture.decode(&blocks, 1)).ok_or_else(broken)?;
    Ok(Decoded { image, texture, png: png(&texels).map_err(|_| broken())? })
}

/// Puts the PNGs in place of the blocks. Returns the bytes of the blocks on the GPU.
pub(super) fn replace(json: &mut Value, buffers: &mut Vec<Bytes>, decoded: Vec<Decoded>) -> BTreeMap<usize, u64> {
    if decoded.is_empty() {
        return BTreeMap::new();
    }
    let mut rewrite = Rewrite::new(json, buffers);
    let mut bytes = BTreeMap::new();
    for Decoded { image, texture, png } in decoded {
        let view = rewrite.replace_view(texture.buffer_view, &png, ViewUse::Image);
        let object = &mut rewrite.list("images")[image];
        object["bufferView"] = json!(view);
        object["mimeType"] = json!("image/png");
        if let Some(extras) = object.get_mut("extras").and_then(Value::as_object_mut) {
            extras.remove("simpliguard");
            if extras.is_empty() {
                object.as_object_mut().map(|object| object.remove("extras"));
            }
        }
        bytes.insert(image, texture.gpu_bytes());
    }
    rewrite.finish();
    bytes
}
