//! Cached bakes: one way from a model to its levels, shared by the command and the plugin.
//!
//! ```text
//! key -> look-up (local cache, shared cache) -> single flight -> look-up (local cache) -> bake -> store
//! ```
//!
//! [`CachedBake::run`] is this way. With `scope: Objects` it goes this way for each object of a scene. With an
//! [`Isolation`] the bake runs in a process of its own. [`Host`] is the program around it: its threads, its messages and its shutdown.
//! [`look_up`] looks in the local cache alone and bakes nothing. [`open_cache`] finds the cache of a
//! project.

mod cached;
mod device;
mod host;
pub mod isolation;
mod memory;
mod object_host;
mod place;
mod result;
mod stage_objects;

pub use cached::{CachedBake, Outcome, look_up};
pub use device::{Processor, find_device};
pub use host::{Host, Notice};
pub use isolation::Isolation;
pub use memory::default_memory;
pub use place::{
    CachePlace, ENV_VAR, OutsideProject, SHARED_ENV_VAR, SIGNING_KEY_ENV_VAR, TRUSTED_KEYS_ENV_VAR, open_cache,
};
pub use result::{BakeResult, DrawSheet, Parts};
pub use stage_objects::StageObjects;
