//! Sources on demand: of models that were imported with `source: OnDemand`, a game has the levels alone, and loads a source
//! when a camera comes near one of its instances.
//!
//! # How it works
//! The file of such a model has a placeholder for each mesh and texture of its source: a triangle without area, an image of
//! one texel. They have the labels of the source, and the entities of an instance have them as their meshes and in their
//! materials. A second file has the source itself, under the same labels. When it is wanted, it is loaded in the background,
//! and its meshes and textures are moved into the places of the placeholders, a few in each frame. When nobody has wanted it
//! for a while, the placeholders return. So no entity changes, and no handle, clip or skin that a game holds.
//!
//! Until the source is there, the most detailed level is shown in its place. Then it fades into the source.
//!
//! # Limits
//! - A game that reads the triangles of a source, for colliders say, finds placeholders while the source is away. It uses
//!   `source: Keep` for such models.
//! - Materials have to be told when a texture comes. Those of other types than `StandardMaterial` have to be registered with
//!   `register_asset_reflect`.
//! - The source of a scene with objects is loaded as one.
//! - The levels and their textures stay loaded as long as the model is.

mod asset_source;
mod contents;
mod materials;
mod need;
mod residency;
mod stamp;

use bevy::asset::AssetPath;
use bevy::prelude::*;

pub use self::asset_source::SOURCE;
pub(super) use self::asset_source::{open, register};
pub(super) use self::residency::{Presence, Residency, update};
pub(super) use self::stamp::{SourceOfFile, is_source};

/// Settings of the sources that are loaded on demand, for the whole app. They may change at any time.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct SourceSettings {
    /// Bytes on the GPU that all sources together may take. The nearest come first.
    pub budget: u64,
    /// Seconds that a source stays after the last time it was wanted.
    pub keep: f32,
    /// Seconds before a camera comes so near that a source is to be seen, at its present speed, at which it is loaded.
    pub ahead: f32,
}

impl Default for SourceSettings {
    fn default() -> Self {
        Self { budget: 512 << 20, keep: 5.0, ahead: 2.0 }
    }
}

/// Statistics of the sources that are loaded on demand.
#[derive(Resource, Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct SourceStats {
    /// Models whose source is loaded on demand.
    pub models: u32,
    /// Those whose source is there.
    pub resident: u32,
    /// Those whose source is on its way.
    pub loading: u32,
    /// Those whose source cannot be loaded.
    pub failed: u32,
    /// Bytes on the GPU of sources that are there or on their way, by their files.
    pub bytes: u64,
}

/// The source of a model that is loaded on demand, on the root entity of each scene of its file.
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
#[require(Presence)]
pub struct OnDemandSource {
    /// The path of the file with the source, in the asset source [`SOURCE`].
    pub file: String,
    /// Bytes of the source on the GPU.
    pub bytes: u64,
    /// The meshes that are placeholders while the source is away.
    pub meshes: Vec<Handle<Mesh>>,
    /// The textures that are placeholders while the source is away.
    pub textures: Vec<Handle<Image>>,
    /// True if meshes are turned to Bevy's forward direction.
    pub rotate_meshes: bool,
    /// True if the source is always wanted, because nothing else of the scene can be shown.
    pub always: bool,
}

impl OnDemandSource {
    /// The path of the model.
    fn model(&self) -> Option<AssetPath<'static>> {
        Some(self.meshes.first()?.path()?.without_label().clone_owned())
    }
}
