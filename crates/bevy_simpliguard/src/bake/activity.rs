//! Which processed files are being read or written, and which of their changes the game has seen.

use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use bevy::platform::collections::HashMap;

use super::readers::PATIENCE;

/// Time that the processor needs at most from one of its steps to the next that is seen from here, and that those who wait
/// for its lock need to get it.
const REST: Duration = Duration::from_secs(1);

/// The processed files of a source, by their paths below it.
#[derive(Debug, Default)]
pub(super) struct Activity(Mutex<HashMap<PathBuf, Record>>);

#[derive(Debug, Default)]
struct Record {
    /// How many process it.
    busy: usize,
    written: Option<Instant>,
    /// When it was last read, and what was there.
    read: Option<(Instant, Stamp)>,
    /// How many read it.
    readers: usize,
    /// What the processor did last with its lock.
    lock: Option<(Lock, Instant)>,
}

/// Where the processor is with the lock of a processed file; see [`super::readers`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lock {
    /// It asks for it, or has found nothing to do.
    Claimed,
    /// It has it, or has failed.
    Held,
    /// It gives it back.
    Released,
}

impl Record {
    fn has_lock(&self, lock: Lock, now: Instant) -> bool {
        let span = if lock == Lock::Held { PATIENCE } else { REST };
        self.lock.is_some_and(|(state, since)| state == lock && now < since + span)
    }

    /// Whether the processor may ask for the lock.
    fn is_free(&self, now: Instant) -> bool {
        let locks = [Lock::Claimed, Lock::Held, Lock::Released];
        self.busy == 0 && self.readers == 0 && !locks.iter().any(|lock| self.has_lock(*lock, now))
    }
}

/// Tells versions of a file apart without reading it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamp([Option<(u64, SystemTime)>; 2]);

impl Stamp {
    /// Of a file and its `.meta`.
    pub(super) fn of(file: &Path) -> Self {
        let mut meta = file.as_os_str().to_owned();
        meta.push(".meta");
        let stamp = |m: Metadata| Some((m.len(), m.modified().ok()?));
        Self([file, Path::new(&meta)].map(|path| fs::metadata(path).ok().and_then(stamp)))
    }
}

impl Activity {
    /// A model is being processed until the guard is dropped.
    pub(super) fn processing<'a>(&'a self, path: &'a Path) -> Processing<'a> {
        self.lock().entry(path.to_owned()).or_default().busy += 1;
        Processing { activity: self, path }
    }

    /// A processed file is being written, or was just now.
    pub(super) fn wrote(&self, path: &Path) {
        self.lock().entry(path.to_owned()).or_default().written = Some(Instant::now());
    }

    /// The processor is about to ask for the lock of a processed file. `false` if it has to wait.
    pub(super) fn claim(&self, path: &Path, now: Instant) -> bool {
        let mut records = self.lock();
        let record = records.entry(path.to_owned()).or_default();
        let is_free = record.is_free(now);
        if is_free {
            record.lock = Some((Lock::Claimed, now));
        }
        is_free
    }

    /// Whether the processor asks for the lock of a processed file.
    pub(super) fn is_claimed(&self, path: &Path, now: Instant) -> bool {
        self.lock().get(path).is_some_and(|record| record.has_lock(Lock::Claimed, now))
    }

    /// The processor has the lock of a processed file.
    pub(super) fn held(&self, path: &Path) {
        self.lock().entry(path.to_owned()).or_default().lock = Some((Lock::Held, Instant::now()));
    }

    /// The processor gives the lock of a processed file back.
    pub(super) fn released(&self, path: &Path) {
        self.lock().entry(path.to_owned()).or_default().lock = Some((Lock::Released, Instant::now()));
    }

    /// Whether a change to the source of a processed file may be told.
    pub(super) fn is_free(&self, path: &Path, now: Instant) -> bool {
        self.lock().get(path).is_none_or(|record| record.is_free(now))
    }

    /// A processed file, at `file`, is about to be read.
    pub(super) fn read(&self, path: &Path, file: &Path) {
        let stamp = Stamp::of(file);
        self.lock().entry(path.to_owned()).or_default().read = Some((Instant::now(), stamp));
    }

    /// A processed file, or its `.meta`, is being read until the guard is dropped.
    pub(super) fn reading(self: &Arc<Self>, path: &Path) -> Reading {
        self.lock().entry(path.to_owned()).or_default().readers += 1;
        Reading { activity: self.clone(), path: path.to_owned() }
    }

    /// A processed file is being exchanged until the guard is dropped: the processor does not ask for its lock before. `None`
    /// while the processor may be writing it.
    pub(super) fn exchanging(self: &Arc<Self>, path: &Path, now: Instant) -> Option<Reading> {
        let mut records = self.lock();
        let record = records.entry(path.to_owned()).or_default();
        let is_written = record.busy > 0 || [Lock::Claimed, Lock::Held].iter().any(|lock| record.has_lock(*lock, now));
        if is_written {
            return None;
        }
        record.readers += 1;
        Some(Reading { activity: self.clone(), path: path.to_owned() })
    }

    /// Whether the processed file at `file` is other than it was when it was last read.
    pub(super) fn is_news(&self, path: &Path, file: &Path) -> bool {
        let records = self.lock();
        let Some(Record { read: Some((at, stamp)), written, .. }) = records.get(path) else { return true };
        written.is_some_and(|written| written >= *at) || Stamp::of(file) != *stamp
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<PathBuf, Record>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// See [`Activity::processing`].
pub(super) struct Processing<'a> {
    activity: &'a Activity,
    path: &'a Path,
}

impl Drop for Processing<'_> {
    fn drop(&mut self) {
        let mut records = self.activity.lock();
        if let Some(record) = records.get_mut(self.path) {
            record.busy -= 1;
            record.written = Some(Instant::now());
        }
    }
}

/// See [`Activity::reading`].
pub(super) struct Reading {
    activity: Arc<Activity>,
    path: PathBuf,
}

impl Drop for Reading {
    fn drop(&mut self) {
        let mut records = self.activity.lock();
        if let Some(record) = records.get_mut(&self.path) {
            record.readers -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_free_when_nobody_reads_or_processes_it() {
        let activity = Arc::new(Activity::default());
        let path = Path::new("a.glb");
        let (start, soon) = (Instant::now(), || Instant::now() + REST);
        assert!(activity.is_free(path, start));
        let (one, two) = (activity.reading(path), activity.reading(path));
        drop(one);
        assert!(!activity.claim(path, soon()) && activity.is_free(Path::new("b.glb"), start));
        drop(two);
        // What is claimed and left is free again after a while.
        assert!(activity.claim(path, start) && !activity.claim(path, start) && activity.is_claimed(path, start));
        assert!(activity.is_free(path, soon()) && activity.claim(path, soon()));
        activity.held(path);
        assert!(!activity.is_free(path, soon()) && !activity.is_claimed(path, start));
        activity.released(path);
        assert!(!activity.is_free(path, start) && activity.is_free(path, soon()));
        let (one, two) = (activity.processing(path), activity.processing(path));
        drop(one);
        assert!(!activity.is_free(path, soon()));
        drop(two);
        assert!(activity.is_free(path, soon()));
    }

    #[test]
    fn a_file_is_either_exchanged_or_processed() {
        let activity = Arc::new(Activity::default());
        let (path, now) = (Path::new("a.glb"), Instant::now());
        let exchanging = activity.exchanging(path, now).expect("free");
        assert!(!activity.claim(path, now));
        drop(exchanging);
        assert!(activity.claim(path, now) && activity.exchanging(path, now).is_none());
        assert!(activity.exchanging(path, now + REST).is_some(), "the processor has found nothing to do");
        activity.held(path);
        assert!(activity.exchanging(path, now).is_none());
        activity.released(path);
        assert!(activity.exchanging(path, now).is_some());
        let processing = activity.processing(path);
        assert!(activity.exchanging(path, now).is_none());
        drop(processing);
        assert!(activity.exchanging(path, now).is_some());
    }

    #[test]
    fn what_was_read_since_it_was_written_is_no_news() {
        let dir = tempfile::tempdir().expect("tempdir");
        let (path, file) = (Path::new("a.glb"), dir.path().join("a.glb"));
        let activity = Activity::default();
        fs::write(&file, "1").expect("writes");
        activity.wrote(path);
        assert!(activity.is_news(path, &file));
        activity.read(path, &file);
        assert!(!activity.is_news(path, &file));
        activity.wrote(path);
        assert!(activity.is_news(path, &file));
        activity.read(path, &file);
        // Whoever else wrote it.
        fs::write(&file, "12").expect("writes");
        assert!(activity.is_news(path, &file));
        activity.read(path, &file);
        fs::write(dir.path().join("a.glb.meta"), "()").expect("writes");
        assert!(activity.is_news(path, &file));
    }
}
