//! Bevy plugin: bakes levels of detail when a glTF model is imported, and switches them while the game runs.

pub mod lod;
