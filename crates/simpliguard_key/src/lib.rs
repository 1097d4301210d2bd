//! Keys: hashes that name results by everything that decides their bytes.
//!
//! The pipeline makes keys, and the cache stores bytes under them. Neither knows the other, so both use this crate.

mod builder;
mod content;
mod key;

pub use builder::KeyBuilder;
pub use content::content_hash;
pub use key::Key;
