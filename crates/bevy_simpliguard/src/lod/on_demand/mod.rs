//! Sources and detailed levels on demand: of models that were imported with `source: OnDemand`, a game has the smallest level
//! alone, and loads a more detailed one, or the source, when a camera comes near one of its instances.
//!
//! # How it works
//! The file of such a model has a placeholder for each mesh and texture of its source and of all levels but the smallest: a
//! triangle without area, an image of one texel. They have the labels of what they stand for, and the entities of an instance
//! have them as their meshes and in their materials. A file for each part, the source or a level, has the part itself, under
//! the same labels. When it is wanted, it is loaded in the background, and its meshes and textures are moved into the places of
//! the placeholders, a few in each frame. When nobody has wanted it for a while, the placeholders return. So no entity changes,
//! and no handle, clip or skin that a game holds.
//!
//! Until a part is there, the next coarser level is shown in its place. Then it fades into the part. A level stays
//! while more detailed ones are shown, so that it is there when the camera goes back.
//!
//! # Limits
//! - A game that reads the triangles of a source, for colliders say, finds placeholders while the source is away. It uses
//!   `source: Keep` for such models.
//! - Materials have to be told when a texture comes. Those of other types than `StandardMaterial` have to be registered with
//!   `register_asset_reflect`.
//! - The source of a scene with objects is loaded as one, and so are the levels of all its objects that have one number.
//! - Levels that stand for all objects of a scene are always there.

mod asset_source;
mod components;
mod contents;
mod materials;
mod need;
mod residency;
mod stamp;

pub use self::asset_source::SOURCE;
pub(super) use self::asset_source::{open, register};
pub(super) use self::components::Presence;
pub use self::components::{OnDemand, OnDemandPart, SourceSettings, SourceStats};
pub(super) use self::residency::{Residency, update};
pub(super) use self::stamp::{PartsOfFile, is_part};
