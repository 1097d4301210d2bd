//! `KHR_texture_basisu`, and KTX2 images in general.
//!
//! Every KTX2 image that a texture shows becomes a PNG. The extension is then removed from the JSON, so that the rest of
//! the import and the export see an ordinary glTF. A texture with an image of another kind beside the KTX2 image keeps
//! the other one.

use std::collections::BTreeSet;

use bytes::Bytes;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::accessor::Reader;
use super::extensions;
use super::images::LONGEST_SIDE;
use super::ktx2::Ktx2;
use super::resources::{SourceImage, mime_of};
use super::schema::Root;
use crate::Error;
use crate::gltf::png::png;
use crate::gltf::rewrite::{Rewrite, ViewUse};

const NAME: &str = "KHR_texture_basisu";
const WEBP: &str = "EXT_texture_webp";

/// A decoded image of the file.
pub(super) struct Decoded {
    /// Its index among the images.
    image: usize,
    /// The view of its KTX2 bytes; `None` if it was given by URI.
    view: Option<usize>,
    /// The PNG, or the reason why it could not be decoded.
    png: Result<Vec<u8>, String>,
}

/// True if a texture has no other image than that of the extension, or if the file requires the extension.
pub(super) fn is_used(root: &Root<'_>) -> bool {
    root.extensions_required.contains(&NAME)
        || root.textures.iter().any(|texture| texture.source.is_none() && texture.extensions.basisu.is_some())
}

/// Decodes the KTX2 images that textures show, in parallel.
///
/// # Errors
/// [`Error::Limit`] if they have too many texels.
pub(super) fn decode(reader: Reader<'_>, images: &[SourceImage]) -> Result<Vec<Decoded>, Error> {
    let shown = |texture: &super::schema::Texture| {
        texture.source.or_else(|| texture.extensions.basisu.as_ref().and_then(|basisu| basisu.source))
    };
    let used: BTreeSet<usize> = reader.root.textures.iter().filter_map(shown).collect();
    let encoded: Vec<(usize, Option<usize>, Bytes)> =
        used.into_iter().filter_map(|image| ktx2_bytes(reader, images, image)).collect();
    let headers: Vec<Result<Ktx2<'_>, String>> =
        encoded.iter().map(|(_, _, bytes)| Ktx2::new(bytes, LONGEST_SIDE)).collect();
    let texels = headers.iter().flatten().fold(0u64, |sum, image| sum.saturating_add(image.texel_count()));
    reader.asset.within("the number of texels of its textures", texels as usize, reader.asset.limits.texels)?;
    // Texels, their colours without alpha, and the PNG.
    reader.asset.allocate("its KTX2 images", texels.saturating_mul(12))?;
    let decode = |(header, (image, view, _)): (Result<Ktx2<'_>, String>, &(usize, Option<usize>, Bytes))| {
        reader.asset.check()?;
        let png = header.and_then(|header| header.decode()).and_then(|texels| png(&texels));
        Ok(Decoded { image: *image, view: *view, png })
    };
    headers.into_par_iter().zip(&encoded).map(decode).collect()
}

/// An image with its view and its bytes, if these are KTX2.
fn ktx2_bytes(reader: Reader<'_>, images: &[SourceImage], image: usize) -> Option<(usize, Option<usize>, Bytes)> {
    let (view, bytes) = match images.get(image)? {
        SourceImage::Read { bytes, .. } => (None, bytes.clone()),
        SourceImage::InBuffer => {
            let view = reader.root.images.get(image)?.buffer_view?;
            (Some(view), reader.view_bytes(view).ok()?)
        }
        SourceImage::Failed { .. } | SourceImage::Undecodable { .. } => return None,
    };
    (mime_of(&bytes) == Some("image/ktx2")).then_some((image, view, bytes))
}

/// Puts the PNGs in place of the KTX2 images.
pub(super) fn replace(json: &mut Value, buffers: &mut Vec<Bytes>, images: &mut [SourceImage], decoded: Vec<Decoded>) {
    let mut rewrite = Rewrite::new(json, buffers);
    for Decoded { image, view, png } in decoded {
        let png = match png {
            Ok(png) => png,
            Err(reason) => {
                images[image] = SourceImage::Undecodable { reason };
                continue;
            }
        };
        match (view, &mut images[image]) {
            (None, SourceImage::Read { bytes, mime, .. }) => (*bytes, *mime) = (Bytes::from(png), "image/png"),
            (Some(view), _) => {
                let view = rewrite.replace_view(view, &png, ViewUse::Image);
                let image = &mut rewrite.list("images")[image];
                image["bufferView"] = json!(view);
                image["mimeType"] = json!("image/png");
            }
            (None, _) => {}
        }
    }
    rewrite.finish();
}

/// Gives each texture without an image of its own that of the extension, and removes the extension there.
pub(super) fn remove_extension(json: &mut Value) {
    let mut is_left = false;
    for texture in json.get_mut("textures").and_then(Value::as_array_mut).into_iter().flatten() {
        if texture.get("source").is_none()
            && let Some(source) =
                extensions::take(texture, &[NAME]).and_then(|mut basisu| basisu.get_mut("source").map(Value::take))
        {
            texture["source"] = source;
        }
        is_left |= texture.pointer("/extensions/KHR_texture_basisu").is_some();
    }
    extensions::undeclare(json, "extensionsRequired", &[NAME]);
    if !is_left {
        extensions::undeclare(json, "extensionsUsed", &[NAME]);
    }
}

/// Gives each texture without an image of its own that of `EXT_texture_webp`, for loaders that read WebP but not the
/// extension.
pub(super) fn add_webp_sources(json: &mut Value) {
    for texture in json.get_mut("textures").and_then(Value::as_array_mut).into_iter().flatten() {
        let source = texture.pointer("/extensions/EXT_texture_webp/source").cloned();
        if let Some(source) = source.filter(|_| texture.get("source").is_none()) {
            texture["source"] = source;
        }
    }
    extensions::undeclare(json, "extensionsRequired", &[WEBP]);
}
