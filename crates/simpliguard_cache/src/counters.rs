//! Counters of the tiers: of this process, and of all processes that have used the cache.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use serde::{Deserialize, Serialize};

/// A file with the counters of all processes, as JSON, and one that is locked while it is changed.
pub(crate) const COUNTERS: &str = "counters.json";
pub(crate) const LOCK: &str = "counting";
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
    pub(crate) fn take(&self) -> TierCounters {
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
