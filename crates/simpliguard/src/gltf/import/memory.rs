//! The budget of memory of a bake.
//!
//! A few hundred bytes of JSON can ask for gigabytes: accessors without bytes, instances, morph targets, images of one
//! colour. So everything is estimated and counted against the budget before it is allocated.

use std::sync::atomic::{AtomicU64, Ordering};

/// The memory that a bake may take, and what is taken.
#[derive(Debug)]
pub(super) struct Memory {
    limit: u64,
    taken: AtomicU64,
}

impl Memory {
    pub(super) fn new(limit: u64) -> Self {
        Self { limit, taken: AtomicU64::new(0) }
    }

    /// The limit in bytes.
    pub(super) fn limit(&self) -> u64 {
        self.limit
    }

    /// Counts `bytes`; false if they are over what is left.
    pub(super) fn take(&self, bytes: u64) -> bool {
        let more = |taken: u64| taken.checked_add(bytes).filter(|sum| *sum <= self.limit);
        self.taken.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).is_ok()
    }

    /// True if `bytes` are left.
    pub(super) fn has(&self, bytes: u64) -> bool {
        self.taken.load(Ordering::Relaxed).checked_add(bytes).is_some_and(|sum| sum <= self.limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_is_not_there_any_more() {
        let memory = Memory::new(10);
        assert!(memory.take(6) && memory.has(4) && !memory.has(5));
        assert!(!memory.take(5) && memory.take(4) && !memory.take(1) && memory.take(0));
        assert!(!memory.has(u64::MAX));
    }
}
