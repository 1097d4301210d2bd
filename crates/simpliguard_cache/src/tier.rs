//! The interface of a shared tier.

use std::fmt::Debug;
use std::io;
use std::ops::Range;

use blake3::Hash;
use simpliguard_key::Key;

use crate::error::StorageError;

/// A place for files that other machines use, too. Each call is one request, which may block for any time.
pub(crate) trait Tier: Debug + Send + Sync {
    /// Reads, and with `write` also writes, a file that tells whether the tier can be used.
    fn probe(&self, write: bool) -> Result<(), Fault>;
    /// The record of a key, if it has at most `most` bytes.
    fn record(&self, key: &Key, most: u64) -> Result<Option<Vec<u8>>, Fault>;
    /// A part of an object. It is shorter if the object ends there.
    fn part(&self, object: &Hash, bytes: Range<u64>) -> Result<Option<Vec<u8>>, Fault>;
    /// Tells whether an object is there with this size in bytes. Its content is not read.
    fn has_object(&self, object: &Hash, size: u64) -> Result<bool, Fault>;
    /// Stores an object. One that is there stays as it is, unless it is damaged.
    fn put_object(&self, object: &Hash, bytes: &[u8], there: There) -> Result<(), Fault>;
    /// Stores the record of a key. One that is there stays as it is, unless it is damaged.
    fn put_record(&self, key: &Key, json: &[u8], there: There) -> Result<(), Fault>;
    /// Sets a damaged file aside, if the tier can. Returns a description of the damage.
    fn set_aside(&self, damaged: Damaged, reason: &str) -> String;
}

/// A file of a tier that does not hold what it should.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Damaged {
    Record(Key),
    Object(Hash),
}

/// A file that is in the way of a new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum There {
    /// It has the same content, if there is one at all. Of several writers, the first one wins.
    Equal,
    /// It was found damaged, or may not be used, and is replaced.
    Bad,
}

/// The answer of a tier that cannot do what it is asked for, with the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The rights do not suffice.
    Denied(String),
    /// There is no such place, whatever is asked for.
    NoPlace(String),
    /// Anything else, which may be better at the next try.
    Failed(String),
}

impl From<StorageError> for Fault {
    fn from(error: StorageError) -> Self {
        match &error {
            StorageError::Io { source, .. }
                if matches!(source.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem) =>
            {
                Self::Denied(error.to_string())
            }
            _ => Self::Failed(error.to_string()),
        }
    }
}
