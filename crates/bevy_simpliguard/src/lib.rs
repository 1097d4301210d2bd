//! Bevy plugin: bakes levels of detail when a glTF model is imported, and switches them while the game runs.

#[cfg(feature = "bake")]
mod bake;
mod plugin;

#[cfg(feature = "bake")]
pub use bake::{BakeFailed, BakeFinished, BakeProgress, BakeStarted, MetaSettings, SimpliguardProcess};
pub use plugin::{BakeMode, SimpliguardPlugin};
