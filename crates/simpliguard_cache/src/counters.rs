//! Counters of the tiers: of this process, and of all processes that have used the cache.

use std::fs::File;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use serde::{Deserialize, Serialize};

use crate::error::StorageError;
use crate::file::Durability;
use crate::store::Cache;
use crate::uploads::Uploads;

/// A file with the counters of all processes, as JSON, and one that is locked while it is changed.
pub(crate) const COUNTERS: &str = "counters.json";
pub(crate) const LOCK: &str = "counting";
/// Largest size of the file in bytes.
const MOST_BYTES: u64 = 4096;

/// The counters of one tier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct TierCounters {
    /// Results that were found and used.
    pub hits: u64,
    /// Results that were not found, or not used. Damaged and untrusted ones are among them.
    pub misses: u64,
    /// Results that were stored.
    pub stored: u64,
    /// Results that did not match their hashes or were no result of this program.
    pub damaged: u64,
    /// Results without a valid signature of a trusted key.
    pub untrusted: u64,
    /// Operations that failed.
    pub failures: u64,
    /// Requests that were sent.
    pub requests: u64,
    /// Bytes of objects and records that were read.
    pub bytes_read: u64,
    /// Bytes of objects and records that were sent. An object that was there already counts, too.
    pub bytes_written: u64,
}

/// The counters of all tiers of a cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Counters {
    /// Of the folder of this machine. Requests and bytes are not counted.
    pub local: TierCounters,
    /// Of the shared tier.
    pub shared: TierCounters,
}

impl std::ops::AddAssign for TierCounters {
    fn add_assign(&mut self, other: Self) {
        let pairs = [
            (&mut self.hits, other.hits),
            (&mut self.misses, other.misses),
            (&mut self.stored, other.stored),
            (&mut self.damaged, other.damaged),
            (&mut self.untrusted, other.untrusted),
            (&mut self.failures, other.failures),
            (&mut self.requests, other.requests),
            (&mut self.bytes_read, other.bytes_read),
            (&mut self.bytes_written, other.bytes_written),
        ];
        for (sum, value) in pairs {
            *sum = sum.saturating_add(value);
        }
    }
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.local += other.local;
        self.shared += other.shared;
    }
}

/// Counters that several threads change.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    pub(crate) hits: AtomicU64,
    pub(crate) misses: AtomicU64,
    pub(crate) stored: AtomicU64,
    pub(crate) damaged: AtomicU64,
    pub(crate) untrusted: AtomicU64,
    pub(crate) failures: AtomicU64,
    pub(crate) requests: AtomicU64,
    pub(crate) bytes_read: AtomicU64,
    pub(crate) bytes_written: AtomicU64,
}

/// Counts something.
pub(crate) fn add(counter: &AtomicU64, number: u64) {
    counter.fetch_add(number, Relaxed);
}

impl Tally {
    /// The counts since the last call.
    fn take(&self) -> TierCounters {
        let take = |counter: &AtomicU64| counter.swap(0, Relaxed);
        TierCounters {
            hits: take(&self.hits),
            misses: take(&self.misses),
            stored: take(&self.stored),
            damaged: take(&self.damaged),
            untrusted: take(&self.untrusted),
            failures: take(&self.failures),
            requests: take(&self.requests),
            bytes_read: take(&self.bytes_read),
            bytes_written: take(&self.bytes_written),
        }
    }
}

impl Cache {
    /// The counters of all processes that have called [`Cache::finish`].
    pub fn counters(&self) -> Counters {
        let json = self.read_file(&self.folder().join(COUNTERS), MOST_BYTES).ok().flatten();
        json.and_then(|json| serde_json::from_slice(&json).ok()).unwrap_or_default()
    }

    /// Waits until all results are in the shared tier, and adds the counts since the last call to [`Self::counters`].
    /// Returns these counts, and the failures of the shared tier that nobody was told of.
    pub fn finish(&self) -> (Counters, Vec<StorageError>) {
        let errors = self.uploads().map(Uploads::finish).unwrap_or_default();
        let shared = self.shared().map(|shared| shared.tally().take()).unwrap_or_default();
        let counts = Counters { local: self.tally().take(), shared };
        if counts != Counters::default() {
            // Without its counters, a cache works all the same.
            let _ = self.save(counts);
        }
        (counts, errors)
    }

    fn save(&self, counts: Counters) -> Result<(), StorageError> {
        let lock = self.own().write(&self.folder().join(LOCK), |path| File::create(path))?;
        let _locked = lock.lock();
        let mut sum = self.counters();
        sum += counts;
        let json = serde_json::to_vec(&sum).unwrap_or_default();
        self.write(&self.folder().join(COUNTERS), &json, Durability::Process)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_of_all_processes_are_added_up() {
        let dir = tempfile::tempdir().expect("tempdir");
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let cache = Cache::new(dir.path());
                    add(&cache.tally().hits, 3);
                    assert_eq!(cache.finish().0.local.hits, 3);
                    assert_eq!(cache.finish().0, Counters::default());
                });
            }
        });
        assert_eq!(Cache::new(dir.path()).counters().local.hits, 24);
        Cache::new(dir.path()).clear().expect("clears");
        assert_eq!(Cache::new(dir.path()).counters(), Counters::default());
        assert!(!Cache::new(dir.path()).folder().exists());
    }
}
