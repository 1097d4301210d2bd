//! Single flight: of all threads and processes that miss a key at the same time, one makes the result.
//!
//! The maker of a result holds the operating system's lock of a file that is named by the key. The lock ends with its
//! owner, even if the owner is killed, and the next one in line takes over. Where files cannot be created or locked,
//! everybody makes the result: the results are equal, only the work is done twice.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread;
use std::time::Duration;

use crate::counters::add;
use crate::fetch::Fetch;
use crate::flight::{Flight, Notice};
use crate::record::Entry;
use crate::store::Cache;

/// Time between two tries to get a lock. It doubles from the first value to the second.
const PAUSES: [Duration; 2] = [Duration::from_millis(10), Duration::from_millis(160)];

/// The outcome of [`Cache::single_flight`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleFlight<T> {
    /// The result was there, perhaps because another one has just made it.
    Found(T),
    /// The result was made here.
    Made(T),
    /// The wait for another maker was cancelled.
    Cancelled,
}

impl Cache {
    /// Gets the result of a key from `find`, or else from the shared tier, or else from `make`, which also stores it.
    ///
    /// A result of the shared tier is stored in this cache and read by `take`, which serves all that the check of the flight lets
    /// pass. No lock is held meanwhile: a tier that hangs keeps nobody else from making the result. A tier that does not answer
    /// soon is not waited for: the result is made meanwhile, and whichever comes first is taken. The flag that `make` gets is
    /// set once the result of the tier is there; `make` may then end with any error. While another thread or process makes the
    /// result, this waits, and then calls `find` again. If that maker has died, `make` is called here. After `make`, the result
    /// is stored in the shared tier.
    ///
    /// The wait blocks the thread. Never call this on a thread that `make` needs, such as one of its pool.
    ///
    /// # Errors
    /// Those of `make` alone.
    pub fn single_flight<T, E>(
        &self,
        flight: &Flight<'_>,
        find: impl Fn() -> Option<T>,
        take: impl Fn(Entry) -> Option<T>,
        make: impl FnOnce(&Arc<AtomicBool>) -> Result<T, E>,
    ) -> Result<SingleFlight<T>, E> {
        if let Some(found) = find() {
            add(&self.tally().hits, 1);
            return Ok(SingleFlight::Found(found));
        }
        add(&self.tally().misses, 1);
        let fetch = self.shared().and_then(|shared| Fetch::begin(shared, flight));
        let soon =
            fetch.as_ref().zip(self.shared()).and_then(|(fetch, shared)| fetch.wait(shared, flight.is_cancelled));
        self.tell_errors(flight);
        if let Some(found) = soon.map(|entry| self.keep(entry, flight)).and_then(&take) {
            return Ok(SingleFlight::Found(found));
        }
        let has_arrived = fetch.as_ref().map_or_else(Arc::default, |fetch| fetch.has_arrived().clone());
        let arrived = || Some(self.keep(fetch.as_ref()?.take()?, flight));
        let is_cancelled = || has_arrived.load(Relaxed) || (flight.is_cancelled)();
        let Some(claim) = Claim::wait_for(self, &Flight { is_cancelled: &is_cancelled, ..*flight }) else {
            return Ok(arrived().and_then(&take).map_or(SingleFlight::Cancelled, SingleFlight::Found));
        };
        if let Some(found) = find() {
            claim.settle(self);
            return Ok(SingleFlight::Found(found));
        }
        match make(&has_arrived) {
            Ok(made) => {
                claim.settle(self);
                self.share(flight);
                self.tell_errors(flight);
                Ok(SingleFlight::Made(made))
            }
            Err(error) => {
                let found = arrived().and_then(&take).ok_or(error)?;
                claim.settle(self);
                Ok(SingleFlight::Found(found))
            }
        }
    }

    /// Stores a result of the shared tier in this cache. It is used even if that fails.
    fn keep(&self, entry: Entry, flight: &Flight<'_>) -> Entry {
        if let Err(error) = self.put(flight.key, &entry) {
            (flight.notify)(Notice::NotKept(error));
        }
        entry
    }

    /// Tells of failures of the shared tier that nobody was told of.
    fn tell_errors(&self, flight: &Flight<'_>) {
        let errors = self.shared().map(|shared| shared.errors()).unwrap_or_default();
        errors.into_iter().for_each(|error| (flight.notify)(error.into()));
    }

    /// Copies a result from this cache to the shared tier, in the background if there is a thread for it.
    fn share(&self, flight: &Flight<'_>) {
        let Some(shared) = self.shared().filter(|shared| shared.is_writable()) else { return };
        let Ok(Some(entry)) = self.read(flight.key, |_| true) else { return };
        let entry = match self.uploads() {
            Some(uploads) => match uploads.push(*flight.key, entry) {
                Ok(()) => return,
                Err(entry) => entry,
            },
            None => entry,
        };
        let is_cancelled = || !shared.is_answering() || (flight.is_cancelled)();
        if let Err(error) = shared.put(&Flight { is_cancelled: &is_cancelled, ..*flight }, entry) {
            (flight.notify)(error.into());
        }
    }
}

/// The right to make one result. It is given back on drop.
struct Claim {
    path: PathBuf,
    /// The locked file. `None` where files cannot be locked.
    file: Option<File>,
}

impl Claim {
    /// Waits for the right. `None` if the wait is cancelled.
    fn wait_for(cache: &Cache, flight: &Flight<'_>) -> Option<Self> {
        let path = cache.path("locks", flight.key.as_bytes());
        let opened =
            cache.own().write(&path, |path| OpenOptions::new().create(true).truncate(false).write(true).open(path));
        let Ok(file) = opened else { return Some(Self { path, file: None }) };
        let mut pause = PAUSES[0];
        loop {
            match file.try_lock() {
                Ok(()) => return Some(Self { path, file: Some(file) }),
                Err(TryLockError::Error(_)) => return Some(Self { path, file: None }),
                Err(TryLockError::WouldBlock) => {}
            }
            if pause == PAUSES[0] {
                (flight.notify)(Notice::Waits);
            }
            if (flight.is_cancelled)() {
                return None;
            }
            thread::sleep(pause);
            pause = (2 * pause).min(PAUSES[1]);
        }
    }

    /// Removes the lock file, because the result is stored: those who wait find the result, and those who come later
    /// need no lock. After a failure the file stays, so that all who wait go on waiting for the same file.
    fn settle(self, cache: &Cache) {
        if self.file.is_some() && cache.owns(&self.path).unwrap_or(false) {
            // If this fails, the next collection removes the empty file.
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::SeqCst};
    use std::sync::mpsc;

    use simpliguard_key::{Key, KeyBuilder};

    use super::*;
    use crate::store::Lookup;

    fn key() -> Key {
        KeyBuilder::new("test").finish()
    }

    fn entry() -> Entry {
        Entry { objects: vec![("a".into(), b"content".to_vec())] }
    }

    fn found(cache: &Cache) -> Option<Entry> {
        if let Lookup::Hit(entry) = cache.get(&key()) { Some(entry) } else { None }
    }

    /// A request that is never cancelled.
    fn flight(key: &Key) -> Flight<'_> {
        Flight { key, is_cancelled: &|| false, notify: &|_| {}, check: |_| Ok(true) }
    }

    #[test]
    fn many_threads_make_one_result() {
        let dir = tempfile::tempdir().expect("tempdir");
        let made = AtomicU32::new(0);
        thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let cache = Cache::new(dir.path());
                    let make = |_: &_| {
                        made.fetch_add(1, SeqCst);
                        thread::sleep(Duration::from_millis(50));
                        cache.put(&key(), &entry()).map(|()| entry())
                    };
                    let outcome = cache.single_flight(&flight(&key()), || found(&cache), Some, make).expect("makes");
                    assert!(matches!(outcome, SingleFlight::Found(e) | SingleFlight::Made(e) if e == entry()));
                });
            }
        });
        assert_eq!(made.into_inner(), 1);
        let locks: Vec<_> = fs::read_dir(Cache::new(dir.path()).folder().join("locks")).expect("lists").collect();
        let left: usize = locks.iter().flatten().map(|d| fs::read_dir(d.path()).expect("lists").count()).sum();
        assert_eq!(left, 0);
    }

    #[test]
    fn after_a_failure_the_next_one_tries() {
        let dir = tempfile::tempdir().expect("tempdir");
        let (cache, key) = (Cache::new(dir.path()), key());
        let flight = Flight { notify: &|notice| panic!("{notice}"), ..flight(&key) };
        let make = |result: Result<u8, &'static str>| cache.single_flight(&flight, || None, |_| None, |_| result);
        assert_eq!(make(Err("no")), Err("no"));
        assert_eq!(make(Ok(1)), Ok(SingleFlight::Made(1)));
    }

    #[test]
    fn a_wait_can_be_cancelled() {
        let dir = tempfile::tempdir().expect("tempdir");
        let (cache, cancelled) = (Cache::new(dir.path()), AtomicBool::new(false));
        let (started, start) = mpsc::channel();
        let (end, ended) = mpsc::channel::<()>();
        thread::scope(|scope| {
            let cache = &cache;
            scope.spawn(move || {
                let make = |_: &_| {
                    started.send(()).expect("listens");
                    ended.recv().map_err(|_| ())
                };
                assert_eq!(cache.single_flight(&flight(&key()), || None, |_| None, make), Ok(SingleFlight::Made(())));
            });
            start.recv().expect("it makes");
            let flight = Flight {
                key: &key(),
                is_cancelled: &|| cancelled.load(SeqCst),
                notify: &|_| cancelled.store(true, SeqCst),
                check: |_| Ok(true),
            };
            let outcome = cache.single_flight(&flight, || None::<()>, |_| None, |_| Err("made twice"));
            assert_eq!(outcome, Ok(SingleFlight::Cancelled));
            end.send(()).expect("waits");
        });
    }

    #[test]
    fn without_locks_everybody_makes() {
        let dir = tempfile::tempdir().expect("tempdir");
        let root = dir.path().join("file");
        fs::write(&root, b"").expect("writes");
        let cache = Cache::new(&root);
        let outcome = cache.single_flight(&flight(&key()), || None, |_| None, |_| Ok::<_, ()>(1));
        assert_eq!(outcome, Ok(SingleFlight::Made(1)));
    }
}
