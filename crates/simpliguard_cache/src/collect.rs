//! Keeping a cache below its size: what was used longest ago goes first.
//!
//! What stages have left behind goes before results, which cost more to make. An object goes with the last result that
//! names it, but never within [`GRACE`] of being written: a writer stores objects first and the record that names them
//! last. Whoever reads what is being removed has a miss.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::folder::State;
use crate::inventory::{Inventory, StoredFile, StoredResult};
use crate::{Cache, Durability, StorageError};

/// The limit of a cache that is given none, in bytes.
pub const DEFAULT_MAX_SIZE: u64 = 10 << 30;

/// Locked by who collects.
const LOCK: &str = "collecting";
/// How large everything is, about, as JSON.
const ESTIMATE: &str = "estimate.json";

/// Nothing that a writer may be about to use is this old.
const GRACE: Duration = Duration::from_secs(600);
/// What is in quarantine is looked at by then.
const QUARANTINE: Duration = Duration::from_secs(7 * 24 * 3600);
/// A full cache is brought down to this part of its limit, so that not every result means a collection.
const LOW_WATER: (u64, u64) = (9, 10);
/// An estimate of the size is not believed for longer.
const ESTIMATE_VALID: Duration = Duration::from_secs(24 * 3600);

/// What a collection has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Collected {
    /// Results that went.
    pub results: u64,
    /// Objects of stages that went.
    pub stages: u64,
    /// Bytes that went.
    pub freed: u64,
    /// Bytes that are left.
    pub left: u64,
}

/// How large the cache is, about.
#[derive(Serialize, Deserialize)]
struct Estimate {
    bytes: u64,
    /// When everything was counted, in seconds since 1970.
    counted: u64,
}

impl Cache {
    /// Removes what nobody can use, and then what was used longest ago until the cache is well below `max_size` bytes.
    /// `None` if another collection is under way.
    ///
    /// # Errors
    /// If nothing can be written there, or the folder is not the cache's own.
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

    /// Removes every file that the cache has put into its folder and every folder that is empty then, and returns the
    /// bytes of the files.
    ///
    /// # Errors
    /// If the folder is not the cache's own; else the first file that cannot be removed, while the others are gone.
    pub fn clear(&self) -> Result<u64, StorageError> {
        self.check()?;
        let inventory = Inventory::of(self);
        let mut result = Ok(inventory.size());
        let single = [LOCK, ESTIMATE].map(|name| self.folder().join(name)).into_iter();
        let single = single.filter(|path| self.own().has_file(path).unwrap_or(false));
        for path in inventory.into_paths().chain(single) {
            match fs::remove_file(&path) {
                Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                    result = result.and(Err(StorageError::Io { action: "remove", path, source }));
                }
                _ => {}
            }
        }
        self.own().remove_empty();
        result
    }

    /// Called when so many bytes were stored. Looks at all files only if the limit seems to be reached.
    pub(crate) fn has_grown(&self, bytes: u64) {
        if self.max_size() == u64::MAX {
            return;
        }
        let estimate = self.estimate().map(|known| Estimate { bytes: known.bytes.saturating_add(bytes), ..known });
        match estimate.filter(|estimate| estimate.bytes <= self.max_size()) {
            Some(estimate) => self.set_estimate(&estimate),
            // What cannot be removed stays; the next one tries again.
            None => drop(self.collect(self.max_size())),
        }
    }

    fn estimate(&self) -> Option<Estimate> {
        let json = self.read_file(&self.folder().join(ESTIMATE)).ok()??;
        let estimate: Estimate = serde_json::from_slice(&json).ok()?;
        // One from the future has no age, so everything is counted.
        let age = seconds_since_1970().checked_sub(estimate.counted)?;
        (age < ESTIMATE_VALID.as_secs()).then_some(estimate)
    }

    /// Two processes at once may lose what one has stored, until everything is counted again.
    fn set_estimate(&self, estimate: &Estimate) {
        if let Ok(json) = serde_json::to_vec(estimate) {
            let _ = self.write(&self.folder().join(ESTIMATE), &json, Durability::Process);
        }
    }
}

fn seconds_since_1970() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs())
}

/// A collection under way.
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

    fn remove_useless(&mut self) {
        let Inventory { temporary, locks, quarantine, results, .. } = &mut self.inventory;
        let temporary = old(temporary, GRACE);
        let locks = old(locks, GRACE);
        let quarantine = old(quarantine, QUARANTINE);
        // Its objects may be on their way to be stored again.
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

    /// Until at most `target` bytes are left.
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

    /// Unless somebody may be about to name it.
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

/// Takes the files out that are older than `age`.
fn old(files: &mut Vec<StoredFile>, age: Duration) -> Vec<StoredFile> {
    files.extract_if(.., |file| file.is_older_than(age)).collect()
}

fn by_use<T>(mut items: Vec<T>, file: impl Fn(&T) -> &StoredFile) -> Vec<T> {
    let key = |item: &T| (file(item).modified, file(item).hex.clone());
    items.sort_by_key(key);
    items
}

/// Whether nobody holds a lock file.
fn is_free(lock: &StoredFile) -> bool {
    File::open(&lock.path).is_ok_and(|file| file.try_lock().is_ok())
}
