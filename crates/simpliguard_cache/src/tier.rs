//! The interface of a shared tier.

use std::fmt::Debug;
use std::ops::Range;

use blake3::Hash;
use simpliguard_key::Key;

/// A place for files that other machines use, too. Each call is one request, which may block for any time.
///
/// `Err` holds the reason of a failure.
pub(crate) trait Tier: Debug + Send + Sync {
    /// The record of a key, if it has at most `most` bytes.
    fn record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, String>;
    /// A part of an object. It is shorter if the object ends there.
    fn part(&self, object: &Hash, bytes: Range<u64>) -> Result<Option<Vec<u8>>, String>;
    /// Tells whether an object is there with this size in bytes. Its content is not read.
    fn has_object(&self, object: &Hash, size: u64) -> Result<bool, String>;
    /// Stores an object, unless it is there.
    fn put_object(&self, object: &Hash, bytes: &[u8]) -> Result<(), String>;
    /// Stores the record of a key.
    fn put_record(&self, key: &Key, json: &[u8]) -> Result<(), String>;
    /// Sets a damaged file aside, if the tier can. Returns a description of the damage.
    fn set_aside(&self, damaged: Damaged, reason: &str) -> String;
}

/// A file of a tier that does not hold what it should.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Damaged {
    Record(Key),
    Object(Hash),
}
