//! Collection: keeps a cache below its size limit. The least recently used files are removed first.
//!
//! Stage objects are removed before results, because results cost more to make. An object is removed with the last
//! result that contains it, but never within [`GRACE`] of being written: a writer stores the objects first and the
//! record last. A reader of a file that is being removed has a miss.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::counters;
use crate::error::StorageError;
use crate::file::Durability;
use crate::folder::State;
use crate::inventory::{Inventory, StoredFile, StoredResult};
use crate::retry::Backoff;
use crate::store::Cache;

/// A file that is locked during a collection.
const LOCK: &str = "collecting";
/// A file with the approximate size of the cache, as JSON.
const ESTIMATE: &str = "estimate.json";
/// Largest size of this file in bytes.
const MOST_ESTIMATE_BYTES: u64 = 4096;

/// Files that a writer may be about to use are younger.
const GRACE: Duration = Duration::from_secs(600);
/// Time for which damaged files are kept in quarantine.
const QUARANTINE: Duration = Duration::from_secs(7 * 24 * 3600);
/// Numerator and denominator of the fraction of the limit that a collection shrinks a full cache to. Below 1, so that
/// not every new result starts a collection.
const LOW_WATER: (u64, u64) = (9, 10);
/// Time for which an estimate of the size is valid.
const ESTIMATE_VALID: Duration = Duration::from_secs(24 * 3600);

/// The outcome of a collection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Collected {
    /// Number of results that were removed.
    pub results: u64,
    /// Number of stage objects that were removed.
    pub stages: u64,
    /// Bytes that were removed.
    pub freed: u64,
    /// Bytes that are left.
    pub left: u64,
}

/// The approximate size of the cache.
#[derive(Serialize, Deserialize)]
struct Estimate {
    bytes: u64,
    /// Time of the last full count, in seconds since 1970.
    counted: u64,
}

impl Cache {
    /// Removes files that nobody can use. If the cache is then larger than `max_size` bytes, removes the least recently
    /// used files until it is well below. `None` if another collection is running.
    ///
    /// # Errors
    /// If the folder cannot be written, or belongs to somebody else.
    pub fn collect(&self, max_size: u64) -> Result<Option<Collected>, StorageError> {
        if matches!(self.own().state(), Ok(State::Missing)) {
            return Ok(Some(Collected::default()));
        }
        let lock = self.own().write(&self.folder().join(LOCK), |path| File::create(path))?;
        if let Err(fs::TryLockError::WouldBlock) = lock.try_lock() {
            return Ok(None);
        }
        let mut collection = Collection::of(self);
        collection.remove_useless();
        if collection.left() > max_size {
            collection.evict(max_size / LOW_WATER.1 * LOW_WATER.0);
        }
        let done = Collected { left: collection.left(), ..collection.done };
        self.set_estimate(&Estimate { bytes: done.left, counted: seconds_since_1970() });
        Ok(Some(done))
    }

    /// Removes every file that the cache has written, and every folder that is empty then. Returns the size of the
    /// files in bytes.
    ///
    /// # Errors
    /// If the folder belongs to somebody else. Otherwise the first file that cannot be removed; all others are removed.
    pub fn clear(&self) -> Result<u64, StorageError> {
        self.check()?;
        let inventory = Inventory::of(self);
        let mut result = Ok(inventory.size());
        let single =
            [LOCK, ESTIMATE, counters::LOCK, counters::COUNTERS].map(|name| self.folder().join(name)).into_iter();
        let single = single.filter(|path| self.own().has_file(path).unwrap_or(false));
        for path in inventory.into_paths().chain(single) {
            match Backoff::for_replacing().retry(|| fs::remove_file(&path)) {
                Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                    result = result.and(Err(StorageError::Io { action: "remove", path, source }));
                }
                _ => {}
            }
        }
        self.own().remove_empty();
        result
    }

    /// Adds stored bytes to the estimated size. Counts all files only if the estimate is above the limit.
    pub(crate) fn has_grown(&self, bytes: u64) {
        if self.max_size() == u64::MAX {
            return;
        }
        let estimate = self.estimate().map(|known| Estimate { bytes: known.bytes.saturating_add(bytes), ..known });
        match estimate.filter(|estimate| estimate.bytes <= self.max_size()) {
            Some(estimate) => self.set_estimate(&estimate),
            // A failed collection is repeated at the next write.
            None => drop(self.collect(self.max_size())),
        }
    }

    fn estimate(&self) -> Option<Estimate> {
        let json = self.read_file(&self.folder().join(ESTIMATE), MOST_ESTIMATE_BYTES).ok()??;
        let estimate: Estimate = serde_json::from_slice(&json).ok()?;
        // An estimate from the future is wrong.
        let age = seconds_since_1970().checked_sub(estimate.counted)?;
        (age < ESTIMATE_VALID.as_secs()).then_some(estimate)
    }

    /// Writes the estimate. If two processes do so at the same time, the bytes of one may be missing until the next
    /// full count.
    fn set_estimate(&self, estimate: &Estimate) {
        if let Ok(json) = serde_json::to_vec(estimate) {
            let _ = self.write(&self.folder().join(ESTIMATE), &json, Durability::Process);
        }
    }
}

fn seconds_since_1970() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs())
}

/// A running collection.
struct Collection {
    inventory: Inventory,
    size: u64,
    done: Collected,
}

impl Collection {
    fn of(cache: &Cache) -> Self {
        let inventory = Inventory::of(cache);
        Self { size: inventory.size(), inventory, done: Collected::default() }
    }

    fn left(&self) -> u64 {
        self.size.saturating_sub(self.done.freed)
    }

    /// Removes the files that nobody can use.
    fn remove_useless(&mut self) {
        let Inventory { temporary, locks, quarantine, results, .. } = &mut self.inventory;
        let temporary = old(temporary, GRACE);
        let locks = old(locks, GRACE);
        let quarantine = old(quarantine, QUARANTINE);
        // A young incomplete result stays: its objects may be about to be stored again.
        let (incomplete, complete) = std::mem::take(results)
            .into_iter()
            .partition::<Vec<_>, _>(|result| !result.is_complete && result.file.is_older_than(GRACE));
        *results = complete;
        for file in temporary.iter().chain(&quarantine) {
            self.remove(file);
        }
        for lock in locks.iter().filter(|lock| is_free(lock)) {
            self.remove(lock);
        }
        for result in incomplete {
            self.done.results += u64::from(self.remove(&result.file));
        }
        let references = self.inventory.references();
        let unused = |object: &&StoredFile| !references.contains_key(object.hex.as_str());
        let unused: Vec<StoredFile> = self.inventory.objects.values().filter(unused).cloned().collect();
        unused.iter().for_each(|object| self.remove_object(object));
    }

    /// Removes the least recently used files until at most `target` bytes are left.
    fn evict(&mut self, target: u64) {
        for file in by_use(std::mem::take(&mut self.inventory.quarantine), |file| file) {
            if self.left() > target {
                self.remove(&file);
            }
        }
        for file in by_use(std::mem::take(&mut self.inventory.stages), |file| file) {
            if self.left() > target {
                self.done.stages += u64::from(self.remove(&file));
            }
        }
        let references = self.inventory.references().into_iter();
        let mut references: BTreeMap<String, usize> = references.map(|(hex, n)| (hex.to_owned(), n)).collect();
        for StoredResult { file, objects, .. } in by_use(std::mem::take(&mut self.inventory.results), |r| &r.file) {
            if self.left() <= target {
                break;
            }
            if !self.remove(&file) {
                continue;
            }
            self.done.results += 1;
            for hex in objects {
                let count = references.entry(hex.clone()).or_default();
                *count = count.saturating_sub(1);
                if *count == 0
                    && let Some(object) = self.inventory.objects.remove(&hex)
                {
                    self.remove_object(&object);
                }
            }
        }
    }

    /// Removes an object, unless a writer may be about to use it in a record.
    fn remove_object(&mut self, object: &StoredFile) {
        let modified = fs::metadata(&object.path).and_then(|data| data.modified());
        let is_old = |modified| StoredFile { modified, ..object.clone() }.is_older_than(GRACE);
        if modified.is_ok_and(is_old) {
            self.remove(object);
        }
    }

    fn remove(&mut self, file: &StoredFile) -> bool {
        let removed = fs::remove_file(&file.path).is_ok();
        if removed {
            self.done.freed += file.size;
        }
        removed
    }
}

/// Takes out the files that are older than `age`.
fn old(files: &mut Vec<StoredFile>, age: Duration) -> Vec<StoredFile> {
    files.extract_if(.., |file| file.is_older_than(age)).collect()
}

/// Sorts by the last use, the oldest first.
fn by_use<T>(mut items: Vec<T>, file: impl Fn(&T) -> &StoredFile) -> Vec<T> {
    let key = |item: &T| (file(item).modified, file(item).hex.clone());
    items.sort_by_key(key);
    items
}

/// Tells whether nobody holds the lock of a file.
fn is_free(lock: &StoredFile) -> bool {
    File::open(&lock.path).is_ok_and(|file| file.try_lock().is_ok())
}
