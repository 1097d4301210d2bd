//! One bake per key at a time, over threads and processes.
//!
//! Who bakes a key holds the operating system's lock on a file that is named by it. The lock ends with its owner,
//! however that ends, and the next in line takes over. Where files cannot be made or locked, everybody bakes: results
//! are equal, and the work alone is done twice.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use simpliguard::Cancellation;

use crate::{Cache, Key, StorageError};

/// Time between two tries to get a lock, which doubles from the first to the second.
const PAUSES: [Duration; 2] = [Duration::from_millis(10), Duration::from_millis(160)];

/// What a user may want to know while a result is looked for; for a line of log.
#[derive(Debug, thiserror::Error)]
pub enum Notice {
    /// Another thread or process makes the result at the moment.
    #[error("somebody else bakes it; waiting")]
    Waits,
    /// The shared tier does not work; this cache goes on without.
    #[error(transparent)]
    Shared(#[from] StorageError),
}

/// What became of a wish for the result of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Once<T> {
    /// It was there, perhaps because somebody else has just made it.
    Found(T),
    /// It was made here.
    Made(T),
    /// The wait for somebody else was cancelled.
    Cancelled,
}

impl Cache {
    /// The result of a key from `find`, or else from `make`, which also stores it. While anybody else in any process makes
    /// it, this waits and then looks again; if that one has died, `make` runs here. Before that, the result is looked for
    /// in the shared tier, and afterwards stored there.
    ///
    /// The wait blocks the thread: never call this from one that `make` needs, such as one of its pool.
    ///
    /// # Errors
    /// Those of `make` alone.
    pub fn once<T, E>(
        &self,
        key: &Key,
        cancellation: &Cancellation,
        tell: impl Fn(Notice),
        find: impl Fn() -> Option<T>,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<Once<T>, E> {
        if let Some(found) = find() {
            return Ok(Once::Found(found));
        }
        let Some(claim) = Claim::wait_for(self, key, cancellation, &tell) else {
            return Ok(Once::Cancelled);
        };
        if let Some(found) = find().or_else(|| if self.fetch(key, &tell) { find() } else { None }) {
            claim.settle(self);
            return Ok(Once::Found(found));
        }
        let made = make()?;
        claim.settle(self);
        self.share(key, &tell);
        Ok(Once::Made(made))
    }

    /// Brings a result here from the shared tier; whether it did.
    fn fetch(&self, key: &Key, tell: &impl Fn(Notice)) -> bool {
        let Some(shared) = self.shared() else { return false };
        let fetched = shared.get(key).and_then(|found| found.map(|entry| self.put(key, &entry)).transpose());
        fetched.map_err(|error| tell(error.into())).is_ok_and(|found| found.is_some())
    }

    /// Brings a result from here to the shared tier.
    fn share(&self, key: &Key, tell: &impl Fn(Notice)) {
        if let Some(shared) = self.shared()
            && let Ok(Some(entry)) = self.read(key, |_| true)
            && let Err(error) = shared.put(key, &entry)
        {
            tell(error.into());
        }
    }
}

/// The right to make one result, given back when dropped.
struct Claim {
    path: PathBuf,
    /// Locked; `None` where locks are not to be had.
    file: Option<File>,
}

impl Claim {
    /// `None` if cancelled.
    fn wait_for(cache: &Cache, key: &Key, cancellation: &Cancellation, tell: &impl Fn(Notice)) -> Option<Self> {
        let path = cache.path("locks", key.as_bytes());
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
                tell(Notice::Waits);
            }
            if cancellation.is_cancelled() {
                return None;
            }
            thread::sleep(pause);
            pause = (2 * pause).min(PAUSES[1]);
        }
    }

    /// The result is stored: who waits for the lock finds it there, and who comes later needs no lock. After a failure
    /// the file stays, so that all who wait for it keep waiting for the same one.
    fn settle(self, cache: &Cache) {
        if self.file.is_some() && cache.owns(&self.path).unwrap_or(false) {
            // One that stays is empty and goes with the next collection.
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering::SeqCst};
    use std::sync::mpsc;

    use super::*;
    use crate::{Entry, KeyBuilder, Lookup};

    fn key() -> Key {
        KeyBuilder::new("test").finish()
    }

    fn entry() -> Entry {
        Entry { made_by: "cpu".into(), objects: vec![("a".into(), b"content".to_vec())] }
    }

    fn found(cache: &Cache) -> Option<Entry> {
        if let Lookup::Hit(entry) = cache.get(&key()) { Some(entry) } else { None }
    }

    #[test]
    fn many_threads_make_one_result() {
        let dir = tempfile::tempdir().expect("tempdir");
        let made = AtomicU32::new(0);
        thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let cache = Cache::new(dir.path());
                    let make = || {
                        made.fetch_add(1, SeqCst);
                        thread::sleep(Duration::from_millis(50));
                        cache.put(&key(), &entry()).map(|()| entry())
                    };
                    let once = cache.once(&key(), &Cancellation::default(), |_| {}, || found(&cache), make);
                    assert!(matches!(once.expect("makes"), Once::Found(e) | Once::Made(e) if e == entry()));
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
        let cache = Cache::new(dir.path());
        let once = |make: fn() -> Result<u8, &'static str>| {
            cache.once(&key(), &Cancellation::default(), |notice| panic!("{notice}"), || None, make)
        };
        assert_eq!(once(|| Err("no")), Err("no"));
        assert_eq!(once(|| Ok(1)), Ok(Once::Made(1)));
    }

    #[test]
    fn a_wait_can_be_cancelled() {
        let dir = tempfile::tempdir().expect("tempdir");
        let (cache, cancellation) = (Cache::new(dir.path()), Cancellation::default());
        let (started, start) = mpsc::channel();
        let (end, ended) = mpsc::channel::<()>();
        thread::scope(|scope| {
            let cache = &cache;
            scope.spawn(move || {
                let make = || {
                    started.send(()).expect("listens");
                    ended.recv().map_err(|_| ())
                };
                assert_eq!(cache.once(&key(), &Cancellation::default(), |_| {}, || None, make), Ok(Once::Made(())));
            });
            start.recv().expect("it makes");
            let tell = |_| cancellation.cancel();
            let once = cache.once(&key(), &cancellation, tell, || None::<()>, || Err("made twice"));
            assert_eq!(once, Ok(Once::Cancelled));
            end.send(()).expect("waits");
        });
    }

    #[test]
    fn without_locks_everybody_makes() {
        let dir = tempfile::tempdir().expect("tempdir");
        let root = dir.path().join("file");
        fs::write(&root, b"").expect("writes");
        let cache = Cache::new(&root);
        let once = cache.once(&key(), &Cancellation::default(), |_| {}, || None, || Ok::<_, ()>(1));
        assert_eq!(once, Ok(Once::Made(1)));
    }
}
