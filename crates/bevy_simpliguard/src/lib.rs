//! Bevy plugin: bakes levels of detail when a glTF model is imported, and switches them while the game runs.
//!
//! [`SimpliguardPlugin`] is all a game adds. [`lod`] is the part that a shipped game keeps: it works on baked files
//! whatever they were baked by. What bakes is behind the feature `bake`, on by default; the feature `overlay` adds a panel
//! that shows both at work.

#[cfg(feature = "bake")]
mod bake;
pub mod lod;
#[cfg(feature = "overlay")]
pub mod overlay;
mod plugin;

#[cfg(feature = "bake")]
pub use bake::{
    BakeFailed, BakeFinished, BakeProgress, BakeStarted, BakeStatus, Bakes, MetaSettings, SimpliguardProcess,
};
pub use lod::{LodSettings, LodStats, SimpliguardLods};
#[cfg(feature = "overlay")]
pub use overlay::{OverlayPlugin, OverlaySettings};
pub use plugin::{BakeMode, BakePriority, SimpliguardPlugin};

/// Compiles what the README shows.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;

/// Compiles what the guide shows.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/bevy.md")]
struct Guide;
