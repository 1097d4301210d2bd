//! A baked file in two: the levels, and the source that a game loads when somebody comes near.
//!
//! Both files have all objects of the whole in their places, so an index or a label means the same in each. What is in the
//! other file has a placeholder: a mesh is a triangle without area between the corners of its box, an image one texel. So
//! a game that puts the meshes and images of the source into the places of the placeholders has the whole, and whatever it
//! holds stays what it is. The source's file has no scenes and no clips.
//!
//! What no level stands for stays with the levels: other nodes, and images that others show too.

mod extras;
mod part;
mod placeholder;

#[cfg(test)]
mod tests;

use serde_json::json;

use self::extras::set_extras;
use self::part::SourcePart;
use super::export::builder::{Builder, Kind};
use super::export::prune::prune;
use crate::{Error, content_hash};

/// Digits of the hash in the name of the source's file. The name only has to differ from those of other versions of one
/// model.
const DIGITS: usize = 16;
/// Objects that keep their indices.
const KEPT: [Kind; 10] = [
    Kind::Scene,
    Kind::Node,
    Kind::Mesh,
    Kind::Skin,
    Kind::Camera,
    Kind::Animation,
    Kind::Material,
    Kind::Texture,
    Kind::Sampler,
    Kind::Image,
];

/// A baked file in two.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Divided {
    /// The file with the levels. Its `asset.extras.simpliguard.source` names the other one, and what that has.
    pub levels: Vec<u8>,
    /// The file with the meshes and images of the source.
    pub source: Vec<u8>,
    /// The name of the file with the source, by its content.
    pub source_name: String,
}

/// Divides a binary glTF of this program. `None` if nothing can be loaded on demand: the file has no levels, or no source, or
/// a scene with some of what the levels stand for and without the rest.
///
/// # Errors
/// [`Error::Invalid`] if the bytes are no binary glTF; [`Error::Limit`] above 4 GiB.
pub fn divide_source(asset: &str, glb: &[u8]) -> Result<Option<Divided>, Error> {
    let whole = Builder::from_glb(asset, glb)?;
    let Some(part) = SourcePart::of(&whole) else { return Ok(None) };
    let mut source = Builder::from_glb(asset, glb)?;
    part.remove_levels(&mut source);
    prune(&mut source, &KEPT);
    let source = source.into_glb()?;
    let source_name = format!("{}.glb", &content_hash(&source).to_hex()[..DIGITS]);
    let mut levels = whole;
    part.remove_source(&mut levels);
    set_extras(
        &mut levels,
        json!({ "source": {
        "file": source_name, "bytes": part.gpu_bytes, "meshes": part.meshes, "textures": part.textures,
    } }),
    );
    prune(&mut levels, &KEPT);
    Ok(Some(Divided { levels: levels.into_glb()?, source, source_name }))
}
