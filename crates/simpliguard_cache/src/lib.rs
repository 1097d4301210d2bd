//! Content-addressed cache: bytes under keys.
//!
//! A [`Key`] stands for everything that decides the bytes of a result. It contains no path and no name, so a renamed
//! file is still found. A result is a few named objects. Each object is stored once, under the hash of its content.
//! All files lie in one folder, `simpliguard-v1`, of the folder that the user gives:
//!
//! ```text
//! CACHEDIR.TAG          marker: the folder is a cache of this program
//! objects/ab/cdef..     one object, named by the hash of its content
//! results/ab/cdef..     JSON record of a key: names, hashes and sizes of its objects
//! stages/ab/cdef..      one stage object behind its own hash, named by its key
//! quarantine/cdef...1.0 a file that did not match its hash, with the id of the process that found it and a count
//! locks/ab/cdef..       empty; locked while the result of a key is made
//! collecting            empty; locked during a collection
//! estimate.json         approximate size of the whole cache
//! counters.json         hits and misses of each tier, of all processes
//! counting              empty; locked while the counters are changed
//! ```
//!
//! A new or empty folder gets the marker. A `simpliguard-v1` without the marker, or one that is a symbolic link,
//! belongs to somebody else: nothing is found there, and storing is an error ([`StorageError::Foreign`]). Only files
//! with the names above are counted, moved or removed, and none behind a symbolic link.
//!
//! A file is written to a temporary file, synced and renamed. So a reader sees the whole file or no file. Every read is
//! checked against the hash. A file that fails the check moves to `quarantine/` and counts as a miss. Storage errors
//! are returned as values for a warning. They never have to stop a bake.
//!
//! If several callers miss the same key at the same time, one of them makes the result and the others wait for it
//! ([`Cache::single_flight`]).
//!
//! A cache has a size limit ([`Cache::with_max_size`]). At the limit, the least recently used files are removed first.
//! The times of the files record their use, to the hour. No file of a cache contains a path, so the folder may be
//! moved.
//!
//! Results, but no stage objects, are also exchanged with a shared tier: a folder on a file server or, with the feature
//! `cloud`, object storage. What is fetched is checked by the caller, too. Every request to the tier has a time limit,
//! and a tier that does not answer in time is not asked again. A record of the tier may have to be signed ([`Trust`]).
//!
//! Limits: a cache may be over its limit for some minutes, because young objects are not removed.

#[cfg(feature = "cloud")]
mod cloud;
mod collect;
mod counters;
mod error;
mod fetch;
mod file;
mod finish;
mod flight;
mod folder;
mod inventory;
mod locate;
mod read;
mod record;
mod requests;
mod retry;
mod shared;
mod signature;
mod single_flight;
mod stage_objects;
mod store;
mod tier;
mod tiers;
mod uploads;
mod verify;

pub use collect::Collected;
pub use counters::{Counters, TierCounters};
pub use error::StorageError;
pub use file::{Durability, can_write_in, remove_stale_temporaries, write_atomic, write_atomic_through};
pub use flight::{Check, Flight, Notice};
pub use inventory::{Amount, Usage};
pub use locate::TierName;
pub use read::read_bounded;
pub use record::Entry;
pub use signature::{PublicKey, SecretKey, Trust};
pub use simpliguard_key::{Key, KeyBuilder};
pub use single_flight::SingleFlight;
pub use store::{Cache, DEFAULT_MAX_SIZE, Lookup, Stats};
pub use verify::Verified;
