//! The export: binary glTF with the source and its levels, or one level alone.
//!
//! # Layout of a combined file
//! The source's scenes, nodes, meshes, skins and animations come first and keep their indices; its buffers and images
//! are embedded. Each level is one mesh and one node for the whole default scene. `MSFT_lod` stands once, on the only
//! root of the default scene, else on its first root with a mesh under it. It lists the level nodes, the most detailed
//! first. Level nodes are roots of their own, in no source scene, with `extras.simpliguard`. Scene `LOD<k>` (after the
//! source's scenes, `LOD1` having the smallest budget) shows one level alone.
//!
//! # Transforms of the levels
//! Static levels have world-space vertices and no transform. A loader shows the level node, without a parent, in place
//! of the nodes in `replaces`, whatever the transform of the node with `MSFT_lod` is. Skinned levels follow their
//! joints, as glTF ignores the transform of a skinned node.
//!
//! A level node of a skinned model uses the source's own joints. They are not in scene `LOD<k>`, but glTF requires the
//! joints of a skinned node in its scene. That scene therefore has a copy of the node tree, and a second node with the
//! same mesh on the copied joints. Both skins share the inverse bind matrices.

#[cfg(test)]
mod asset_tests;
pub(super) mod builder;
pub(super) mod clips;
mod combined;
pub(super) mod embed;
pub(super) mod fault;
pub(super) mod hierarchy;
mod level;
pub(super) mod lods;
pub(super) mod material;
mod params;
pub(super) mod prune;
pub(super) mod ranges;
mod single;
mod skin;
#[cfg(test)]
mod tests;
pub(super) mod textures;
mod vertex_order;
mod vertices;

use self::params::CRATE_VERSION;
use crate::data::{Level, Model};
use crate::{Cancellation, Error};

pub(crate) use self::combined::export_in;
pub(super) use self::embed::embed;
pub(super) use self::fault::fault;
pub use self::params::ExportParams;
pub use self::single::export_level;

/// The source with `levels`, ascending by budget, as one binary glTF.
///
/// # Errors
/// [`Error::Invalid`] for a level whose arrays do not match, and for levels on more than 256 joints of several skins;
/// [`Error::Limit`] above 4 GiB.
pub fn export(model: &Model, levels: &[Level], params: &ExportParams) -> Result<Vec<u8>, Error> {
    export_in(model, levels, params, CRATE_VERSION, &Cancellation::default())
}
