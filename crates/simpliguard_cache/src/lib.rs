//! Content-addressed cache of baked models.
//!
//! A [`Key`] is derived from everything that decides the bytes of a result: the version of the chain, the input bytes
//! and the settings. No path, thread count or backend is part of it, so a renamed file is still found. A result is a
//! few named objects; each object is stored once under the hash of its content. Everything lies in one folder,
//! `simpliguard-v1`, of the folder that the user gives:
//!
//! ```text
//! CACHEDIR.TAG          marker: the folder is a cache of this program
//! objects/ab/cdef..     content, named by its own hash
//! results/ab/cdef..     JSON record of a key: the names, hashes and sizes of its objects, and who made it
//! stages/ab/cdef..      what a stage left behind for later bakes, behind its own hash; named by its key
//! quarantine/cdef...1.0 what did not match its hash, with the number of the process that found it and a count
//! locks/ab/cdef..       empty; locked by who makes the result of a key
//! collecting            empty; locked by who removes what is not used any more
//! estimate.json         how large everything is, about
//! ```
//!
//! The marker is written when the folder is new or empty. A `simpliguard-v1` without it, or that is a symbolic link, is
//! somebody else's: nothing is found there, and storing is an error ([`StorageError::Foreign`]). Only files with the
//! names above are counted, moved or removed, and none that a symbolic link leads to.
//!
//! Files are written beside their place, synced and renamed, so a reader sees all of a file or none. Whatever is read is
//! checked against its hash; what fails is moved to `quarantine/` and counts as a miss. Storage errors are returned as
//! values for a warning; they never need to stop a bake.
//!
//! Of all who miss the same key, one bakes and the others wait for it ([`Cache::once`]).
//!
//! A cache has a limit ([`Cache::with_max_size`]). When it is reached, what was used longest ago goes first; the times of
//! files say when, to the hour. Nothing in a cache names a path, so that its folder may be moved.
//!
//! Results, but not what stages leave behind, also go to and come from a shared tier: a folder on a file server, or, with
//! the feature `cloud`, object storage.
//!
//! Limits: the limit may be passed for some minutes, while new objects are too young to be removed.

mod bake;
#[cfg(feature = "cloud")]
mod cloud;
mod collect;
mod file;
mod flight;
mod folder;
mod inventory;
mod place;
mod record;
mod shared;
mod stages;
mod store;
mod verify;

pub use bake::{BakeResult, Draw, bake_key};
pub use collect::{Collected, DEFAULT_MAX_SIZE};
pub use file::{Durability, can_write_in, write_atomic, write_atomic_through};
pub use flight::{Notice, Once};
pub use inventory::{Amount, Usage};
pub use place::{ENV_VAR, Explicit, OutsideProject};
pub use shared::SHARED_ENV_VAR;
pub use simpliguard::{Key, KeyBuilder};
pub use store::{Cache, Entry, Lookup, Stats, StorageError};
pub use verify::Verified;
