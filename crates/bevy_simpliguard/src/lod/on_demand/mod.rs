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
mod components;
mod contents;
mod materials;
mod need;
mod residency;
mod stamp;

pub use self::asset_source::SOURCE;
pub(super) use self::asset_source::{open, register};
pub(super) use self::components::Presence;
pub use self::components::{OnDemandSource, SourceSettings, SourceStats};
pub(super) use self::residency::{Residency, update};
pub(super) use self::stamp::{SourceOfFile, is_source};
