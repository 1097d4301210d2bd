//! Settings, statistics and components of sources and levels on demand.

use bevy::asset::AssetPath;
use bevy::prelude::*;

use crate::lod::distance::FADE_STEPS;

/// Settings of the sources and levels that are loaded on demand, for the whole app. They may change at any time.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct SourceSettings {
    /// Bytes on the GPU that all sources and levels together may take. The nearest come first.
    pub budget: u64,
    /// Seconds that a source or level stays after it was last wanted.
    pub keep: f32,
    /// Seconds ahead of need at which a source or level is loaded. The camera's present speed tells when it will be needed.
    pub ahead: f32,
}

impl Default for SourceSettings {
    fn default() -> Self {
        Self { budget: 512 << 20, keep: 5.0, ahead: 2.0 }
    }
}

/// Statistics of the sources and levels that are loaded on demand.
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
    /// Levels that were loaded on demand and are there. The smallest ones are always there and do not count.
    pub levels: u32,
    /// Bytes on the GPU of sources and levels that are there or on their way, by their files.
    pub bytes: u64,
}

/// The parts of a model that are loaded on demand. It is on the root entity of each scene that may show one of them.
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
pub struct OnDemand {
    /// The source and the levels.
    pub parts: Vec<OnDemandPart>,
    /// True if meshes are turned to Bevy's forward direction.
    pub rotate_meshes: bool,
}

/// A source or a level that is loaded on demand.
#[derive(Reflect, Clone, Debug)]
pub struct OnDemandPart {
    /// Number of the level: 0 is the source.
    pub level: u32,
    /// The path of its file, in the asset source [`SOURCE`](super::SOURCE).
    pub file: String,
    /// Its bytes on the GPU.
    pub bytes: u64,
    /// The meshes that are placeholders while it is away.
    pub meshes: Vec<Handle<Mesh>>,
    /// The textures that are placeholders while it is away.
    pub textures: Vec<Handle<Image>>,
    /// True if it is always wanted, because nothing else of the scene can be shown.
    pub always: bool,
}

impl OnDemandPart {
    /// The path of the model.
    pub(super) fn model(&self) -> Option<AssetPath<'static>> {
        Some(self.meshes.first()?.path()?.without_label().clone_owned())
    }
}

/// The presence of a scene's source and levels that are loaded on demand.
#[derive(Component, Reflect, Clone, Debug)]
#[reflect(Component, Clone)]
pub(in crate::lod) struct Presence(pub(super) Vec<PartPresence>);

/// The presence of a source or a level.
#[derive(Reflect, Clone, Debug, PartialEq)]
pub(super) struct PartPresence {
    pub(super) level: u32,
    /// The sixteenths of its pixels that may be seen. `None` while it is away.
    pub(super) steps: Option<u8>,
    /// The distance at the last look.
    pub(super) before: f32,
}

impl Presence {
    /// The presence of parts that are all away.
    pub(in crate::lod) fn none(of: &OnDemand) -> Self {
        let away = |part: &OnDemandPart| PartPresence { level: part.level, steps: None, before: f32::INFINITY };
        Self(of.parts.iter().map(away).collect())
    }

    /// The sixteenths of a level's pixels that may be seen. `None` while it is away. A level that is not loaded on demand has all
    /// sixteen.
    pub(in crate::lod) fn steps(&self, level: u32) -> Option<u8> {
        self.0.iter().find(|part| part.level == level).map_or(Some(FADE_STEPS), |part| part.steps)
    }
}
