//! The end of a run: uploads are waited for, and its counts are added to those of all processes.

use std::fs::File;

use crate::counters::{COUNTERS, Counters, LOCK};
use crate::error::StorageError;
use crate::file::Durability;
use crate::store::Cache;
use crate::uploads::Uploads;

/// Largest size of the file in bytes.
const MOST_BYTES: u64 = 4096;

impl Cache {
    /// The counters of all processes that have called [`Cache::finish`].
    pub fn counters(&self) -> Counters {
        let json = self.read_file(&self.folder().join(COUNTERS), MOST_BYTES).ok().flatten();
        json.and_then(|json| serde_json::from_slice(&json).ok()).unwrap_or_default()
    }

    /// Waits until all results are in the shared tier, and adds the counts since the last call to [`Self::counters`].
    /// Returns these counts, and the failures of the shared tier that nobody was told of.
    pub fn finish(&self) -> (Counters, Vec<StorageError>) {
        self.uploads().into_iter().for_each(Uploads::finish);
        let errors = self.shared().map(|shared| shared.errors()).unwrap_or_default();
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
    use crate::counters::add;

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
