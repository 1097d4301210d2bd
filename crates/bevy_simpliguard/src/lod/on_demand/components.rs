//! What a game sets and sees of sources on demand.

use bevy::asset::AssetPath;
use bevy::prelude::*;

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
    /// The path of the file with the source, in the asset source [`SOURCE`](super::SOURCE).
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
    pub(super) fn model(&self) -> Option<AssetPath<'static>> {
        Some(self.meshes.first()?.path()?.without_label().clone_owned())
    }
}

/// The sixteenths of an instance's source that may be seen, and what is known of its distance. 0 while the source is away.
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
pub(in crate::lod) struct Presence {
    pub(in crate::lod) steps: u8,
    /// The distance at the last look.
    pub(super) before: f32,
}

impl Default for Presence {
    fn default() -> Self {
        Self { steps: 0, before: f32::INFINITY }
    }
}
