//! Bevy plugin: bakes levels of detail when a glTF model is imported, and switches them while the game runs.

#[cfg(feature = "bake")]
mod bake;
pub mod lod;
mod plugin;

#[cfg(feature = "bake")]
pub use bake::{BakeFailed, BakeFinished, BakeProgress, BakeStarted, MetaSettings, SimpliguardProcess};
pub use lod::{LodSettings, LodStats, SimpliguardLods};
pub use plugin::{BakeMode, SimpliguardPlugin};
