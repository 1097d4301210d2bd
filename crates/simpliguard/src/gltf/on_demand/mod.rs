//! A baked file in parts: the smallest levels, and what a game loads when somebody comes near: the source, and each more
//! detailed level.
//!
//! All files have all objects of the whole in their places, so an index or a label means the same in each. What is in another
//! file has a placeholder: a mesh is a triangle without area between the corners of its box, an image one texel. So a game that
//! puts the meshes and images of a part into the places of the placeholders has the whole, and whatever it holds stays what it
//! is. The files of parts have no scenes and no clips.
//!
//! Nodes that no level stands for, and images that several parts show, stay with the smallest levels. So do levels that stand for
//! all objects.

mod extras;
mod part;
mod placeholder;

#[cfg(test)]
mod tests;

use serde_json::{Value, json};

use self::extras::set_extras;
use self::part::Part;
use super::export::builder::{Builder, Kind};
use super::export::prune::prune;
use crate::{Error, content_hash};

/// Digits of the hash in the names of the files of parts. They only have to differ from those of other versions of one model.
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

/// A baked file in parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Divided {
    /// The file with the smallest levels. Its `asset.extras.simpliguard` names the others, and what they have: the source as
    /// `source`, and the more detailed levels as `levels`.
    pub levels: Vec<u8>,
    /// The files that are loaded on demand: the source is the first.
    pub parts: Vec<DividedPart>,
}

/// The file of a source, or of a level.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DividedPart {
    /// Its name. What comes before an underscore, if there is one, is the same for all parts of a file, by the content of them
    /// all.
    pub name: String,
    /// The binary glTF.
    pub bytes: Vec<u8>,
}

/// Divides a binary glTF of this program. `None` if nothing can be loaded on demand: the file has no levels, or no source, or
/// a scene with some of what the levels stand for and without the rest.
///
/// # Errors
/// [`Error::Invalid`] if the bytes are no binary glTF; [`Error::Limit`] above 4 GiB.
pub fn divide(asset: &str, glb: &[u8]) -> Result<Option<Divided>, Error> {
    let mut levels = Builder::from_glb(asset, glb)?;
    let parts = Part::all(&levels);
    if parts.is_empty() {
        return Ok(None);
    }
    let write = |part: &Part| {
        let mut file = Builder::from_glb(asset, glb)?;
        part.remove_rest(&mut file);
        prune(&mut file, &KEPT);
        file.into_glb()
    };
    let files: Vec<Vec<u8>> = parts.iter().map(write).collect::<Result<_, Error>>()?;
    let version = &content_hash(&files.concat()).to_hex()[..DIGITS];
    let names: Vec<String> = parts.iter().map(|part| part.file_name(version)).collect();
    parts.iter().for_each(|part| part.remove(&mut levels));
    let stamps: Vec<Value> = parts.iter().zip(&names).map(|(part, name)| part.stamp(name)).collect();
    set_extras(&mut levels, json!({ "source": stamps[0], "levels": stamps[1..] }));
    prune(&mut levels, &KEPT);
    let parts = names.into_iter().zip(files).map(|(name, bytes)| DividedPart { name, bytes }).collect();
    Ok(Some(Divided { levels: levels.into_glb()?, parts }))
}
