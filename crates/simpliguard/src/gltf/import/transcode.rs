//! Images that few loaders read: KTX2 (`KHR_texture_basisu`) and WebP (`EXT_texture_webp`).
//!
//! Every such image that a texture shows becomes a PNG. The extensions are then removed from the JSON, so that the rest of
//! the import and the export see an ordinary glTF. A texture with an image of another kind beside that of an extension
//! keeps the other one.

use std::collections::BTreeSet;

use bytes::Bytes;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::accessor::Reader;
use super::asset::Asset;
use super::extensions;
use super::images::{AT_ONCE, LONGEST_SIDE};
use super::ktx2::Ktx2;
use super::resources::{SourceImage, mime_of};
use super::schema::{Root, Texture};
use super::webp::WebP;
use crate::Error;
use crate::gltf::png::png;
use crate::gltf::rewrite::{Rewrite, ViewUse};

/// The extensions, in the order in which a texture without an image of its own takes theirs.
const NAMES: [&str; 2] = ["KHR_texture_basisu", "EXT_texture_webp"];

/// The most bytes of a texel in a PNG, all but exactly.
const PNG_BYTES: u64 = 4;
/// Bytes of a texel while it is decoded: as it is stored and as RGBA, then as RGBA and without alpha.
const DECODING_BYTES: u64 = 8;

/// A decoded image of the file.
pub(super) struct Decoded {
    /// Its index among the images.
    image: usize,
    /// The view of its encoded bytes; `None` if it was given by URI.
    view: Option<usize>,
    /// The PNG, or the reason why it could not be decoded.
    png: Result<Vec<u8>, String>,
}

/// An image whose header was read.
enum Encoded<'a> {
    Ktx2(Ktx2<'a>),
    WebP(WebP<'a>),
}

impl<'a> Encoded<'a> {
    /// `None` if the bytes are an image of another kind, or a WebP image that cannot be read: the import of the images
    /// reports that one if a material shows it.
    fn new(bytes: &'a [u8]) -> Option<Result<Self, String>> {
        match mime_of(bytes)? {
            "image/ktx2" => Some(Ktx2::new(bytes, LONGEST_SIDE).map(Self::Ktx2)),
            "image/webp" => WebP::new(bytes, LONGEST_SIDE).map(|image| Ok(Self::WebP(image))),
            _ => None,
        }
    }

    fn texel_count(&self) -> u64 {
        match self {
            Self::Ktx2(image) => image.texel_count(),
            Self::WebP(image) => image.texel_count(),
        }
    }

    /// The PNG, or the reason why there is none. `None` if a WebP image is broken behind its header.
    fn png(&self) -> Option<Result<Vec<u8>, String>> {
        match self {
            Self::Ktx2(image) => Some(image.decode().and_then(|texels| png(&texels))),
            Self::WebP(image) => image.decode().map(|texels| png(&texels)),
        }
    }
}

/// True if a texture has no other image than that of an extension, or if the file requires one of them.
pub(super) fn is_used(root: &Root<'_>) -> bool {
    let has_no_other = |texture: &Texture| texture.source.is_none() && shown(texture).is_some();
    root.extensions_required.iter().any(|name| NAMES.contains(name)) || root.textures.iter().any(has_no_other)
}

/// The image of a texture.
fn shown(texture: &Texture) -> Option<usize> {
    let of_extension = [&texture.extensions.basisu, &texture.extensions.webp].into_iter().flatten();
    texture.source.or_else(|| of_extension.filter_map(|extension| extension.source).next())
}

/// Decodes the images that textures show, in parallel.
///
/// # Errors
/// [`Error::Limit`] if they have too many texels.
pub(super) fn decode(reader: Reader<'_>, images: &[SourceImage]) -> Result<Vec<Decoded>, Error> {
    let used: BTreeSet<usize> = reader.root.textures.iter().filter_map(shown).collect();
    let bytes: Vec<(usize, Option<usize>, Bytes)> =
        used.into_iter().filter_map(|image| bytes_of(reader, images, image)).collect();
    let encoded: Vec<(usize, Option<usize>, Result<Encoded<'_>, String>)> =
        bytes.iter().filter_map(|(image, view, bytes)| Some((*image, *view, Encoded::new(bytes)?))).collect();
    check_memory(reader.asset, encoded.iter().filter_map(|(_, _, header)| Some(header.as_ref().ok()?.texel_count())))?;
    let decode = |(image, view, header): (usize, Option<usize>, Result<Encoded<'_>, String>)| {
        reader.asset.check()?;
        let png = header.map_or_else(|reason| Some(Err(reason)), |header| header.png());
        Ok(png.map(|png| Decoded { image, view, png }))
    };
    encoded.into_par_iter().map(decode).filter_map(Result::transpose).collect()
}

/// Checks numbers of texels against the limits.
fn check_memory(asset: Asset<'_>, texel_counts: impl Iterator<Item = u64>) -> Result<(), Error> {
    let mut texel_counts: Vec<u64> = texel_counts.collect();
    texel_counts.sort_unstable_by(|a, b| b.cmp(a));
    let sum = |counts: &[u64]| counts.iter().fold(0u64, |sum, count| sum.saturating_add(*count));
    let texels = sum(&texel_counts);
    asset.within("the number of texels of its textures", texels as usize, asset.limits.texels)?;
    asset.allocate("its KTX2 and WebP images", texels.saturating_mul(PNG_BYTES))?;
    let at_once = sum(&texel_counts[..texel_counts.len().min(AT_ONCE)]);
    asset.fits("the decoding of its KTX2 and WebP images", at_once.saturating_mul(DECODING_BYTES))
}

/// An image with its view and its bytes.
fn bytes_of(reader: Reader<'_>, images: &[SourceImage], image: usize) -> Option<(usize, Option<usize>, Bytes)> {
    match images.get(image)? {
        SourceImage::Read { bytes, .. } => Some((image, None, bytes.clone())),
        SourceImage::InBuffer => {
            let view = reader.root.images.get(image)?.buffer_view?;
            Some((image, Some(view), reader.view_bytes(view).ok()?))
        }
        SourceImage::Failed { .. } | SourceImage::Undecodable { .. } => None,
    }
}

/// Puts the PNGs in place of the images.
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

/// Gives each texture without an image of its own that of an extension, and removes the extensions there.
pub(super) fn remove_extensions(json: &mut Value) {
    let mut left = BTreeSet::new();
    for texture in json.get_mut("textures").and_then(Value::as_array_mut).into_iter().flatten() {
        if texture.get("source").is_none() {
            let taken = NAMES.map(|name| extensions::take(texture, &[name]));
            let mut sources = taken.into_iter().flatten().filter_map(|mut taken| Some(taken.get_mut("source")?.take()));
            if let Some(source) = sources.next() {
                texture["source"] = source;
            }
        }
        let extensions = texture.get("extensions").and_then(Value::as_object);
        left.extend(NAMES.into_iter().filter(|&name| extensions.is_some_and(|all| all.contains_key(name))));
    }
    extensions::undeclare(json, "extensionsRequired", &NAMES);
    let gone: Vec<&str> = NAMES.into_iter().filter(|name| !left.contains(name)).collect();
    extensions::undeclare(json, "extensionsUsed", &gone);
}
