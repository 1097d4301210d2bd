//! Bevy plugin: bakes levels of detail when a glTF model is imported, and switches them while the game runs.
//!
//! A game adds [`SimpliguardPlugin`]. The module [`lod`] switches levels. It works on baked files of any origin, and a
//! shipped game needs nothing else. The baking code is behind the feature `bake`, which is on by default. The feature
//! `overlay` adds a panel that shows bakes and levels.

#[cfg(feature = "bake")]
mod bake;
pub mod lod;
mod options;
#[cfg(feature = "overlay")]
pub mod overlay;
mod plugin;

#[cfg(feature = "bake")]
pub use bake::{
    BakeFailed, BakeFinished, BakeProgress, BakeStarted, BakeStatus, Bakes, MetaSettings, SimpliguardProcess,
};
pub use lod::{LodSettings, LodStats, SimpliguardLods, SourceSettings, SourceStats};
pub use options::{BakeBackend, BakeMode, BakePriority};
#[cfg(feature = "overlay")]
pub use overlay::{OverlayPlugin, OverlaySettings};
pub use plugin::SimpliguardPlugin;

/// Compiles the code of the README.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;

/// Compiles the code of the guide.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/bevy.md")]
struct Guide;
