//! The shared tier: results of other machines.
//!
//! A result that is missing here is fetched from the tier, checked and stored here. A result that is made here is
//! stored in the tier too. A tier that fails is left alone for a while. It never stops a bake.

use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use simpliguard_key::Key;

use crate::error::StorageError;
use crate::record::Entry;

/// Time for which a tier that failed is left alone.
const PAUSE: Duration = Duration::from_secs(60);

/// A place for results that other machines use, too.
pub(crate) trait Tier: Debug + Send + Sync {
    /// The result of a key, checked against its hashes. `Err` holds the reason of a failure.
    fn get(&self, key: &Key) -> Result<Option<Entry>, String>;
    /// Stores a result.
    fn put(&self, key: &Key, entry: &Entry) -> Result<(), String>;
}

/// A tier as a cache uses it.
#[derive(Debug)]
pub(crate) struct Shared {
    address: String,
    tier: Result<Box<dyn Tier>, String>,
    read_only: bool,
    /// Time of the last failure.
    failed: Mutex<Option<Instant>>,
}

impl Shared {
    /// The tier at `address`, or the reason why it cannot be opened.
    pub(crate) fn new(address: &str, tier: Result<Box<dyn Tier>, String>, read_only: bool) -> Self {
        Self { address: address.to_owned(), tier, read_only, failed: Mutex::default() }
    }

    pub(crate) fn get(&self, key: &Key) -> Result<Option<Entry>, StorageError> {
        Ok(self.ask("read from", |tier| tier.get(key))?.flatten())
    }

    pub(crate) fn put(&self, key: &Key, entry: &Entry) -> Result<(), StorageError> {
        if self.read_only {
            return Ok(());
        }
        self.ask("write to", |tier| tier.put(key, entry)).map(drop)
    }

    /// Calls `operation` with the tier. `None` while the tier is left alone.
    fn ask<T>(
        &self,
        action: &'static str,
        operation: impl FnOnce(&dyn Tier) -> Result<T, String>,
    ) -> Result<Option<T>, StorageError> {
        let failed = || self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        if failed().is_some_and(|at| at.elapsed() < PAUSE) {
            return Ok(None);
        }
        let answer = self.tier.as_ref().map_err(String::clone).and_then(|tier| operation(tier.as_ref()));
        answer.map(Some).map_err(|reason| {
            *failed() = Some(Instant::now());
            StorageError::Shared { action, address: self.address.clone(), reason }
        })
    }
}
