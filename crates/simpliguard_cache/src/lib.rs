//! Content-addressed cache of baked models.
//!
//! A [`Key`] is derived from everything that decides the bytes of a result: the version of the chain, the input bytes
//! and the settings. No path, thread count or backend is part of it, so a renamed file is still found. A result is a
//! few named objects; each object is stored once under the hash of its content:
//!
//! ```text
//! objects/ab/cdef..     content, named by its own hash
//! results/ab/cdef..     JSON record of a key: the names, hashes and sizes of its objects, and who made it
//! quarantine/           what did not match its hash
//! ```
//!
//! Files are written beside their place, synced and renamed, so a reader sees all of a file or none. Whatever is read is
//! checked against its hash; what fails is moved to `quarantine/` and counts as a miss. Storage errors are returned as
//! values for a warning; they never need to stop a bake.
//!
//! Limits: nothing is evicted, and two processes that miss the same key both bake it (the second finds equal objects).

mod bake;
mod file;
mod key;
mod place;
mod store;

pub use bake::{BakeResult, Draw, bake_key};
pub use file::{Durability, can_write_in, write_atomic, write_atomic_through};
pub use key::{Key, KeyBuilder};
pub use place::{ENV_VAR, place};
pub use store::{Cache, Entry, Lookup, Stats, StorageError};
