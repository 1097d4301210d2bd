//! A request for the result of a key, and the events on the way to it.

use simpliguard_key::Key;

use crate::error::StorageError;
use crate::record::Entry;

/// An event on the way to a result, for a line of the log.
#[derive(Debug, thiserror::Error)]
pub enum Notice {
    /// Another thread or process is making the result.
    #[error("another program is making it; waiting")]
    Waits,
    /// The shared tier failed; the cache goes on without it.
    #[error(transparent)]
    Shared(#[from] StorageError),
    /// A result of the shared tier cannot be stored here. It is used all the same.
    #[error("the result is not kept: {0}")]
    NotKept(StorageError),
}

/// Checks that a result of the shared tier is what it says: `Err` describes what it is, and such a result is neither used nor
/// stored. `Ok(false)` if it is sound but lacks what the caller needs.
pub type Check = fn(&Entry) -> Result<bool, String>;

/// A request for the result of a key.
#[derive(Clone, Copy)]
pub struct Flight<'a> {
    /// The key.
    pub key: &'a Key,
    /// Asked while another one makes the result: `true` ends the wait.
    pub is_cancelled: &'a dyn Fn() -> bool,
    /// Receives the events on the way.
    pub notify: &'a dyn Fn(Notice),
    /// Looks at results of the shared tier.
    pub check: Check,
}
