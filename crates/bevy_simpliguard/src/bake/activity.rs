//! Which processed files are being written, and which of their changes the game has seen.

use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use bevy::platform::collections::HashMap;

/// Time in which a game begins to load a processed file that was written. Bevy 0.19 stops for good if the same file is
/// to be processed again right then: the game, which holds a lock of the file for reading and asks for it a second time,
/// waits for the processor, and the processor for the game.
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
}

/// Tells versions of a file apart without reading it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stamp([Option<(u64, SystemTime)>; 2]);

impl Stamp {
    /// Of a file and its `.meta`.
    fn of(file: &Path) -> Self {
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

    /// A processed file, at `file`, is about to be read.
    pub(super) fn read(&self, path: &Path, file: &Path) {
        let stamp = Stamp::of(file);
        self.lock().entry(path.to_owned()).or_default().read = Some((Instant::now(), stamp));
    }

    /// How long a change to the source of a processed file has to wait; zero if it may be told.
    pub(super) fn rest(&self, path: &Path, now: Instant) -> Duration {
        match self.lock().get(path) {
            None => Duration::ZERO,
            Some(record) if record.busy > 0 => REST,
            Some(record) => record.written.map_or(Duration::ZERO, |at| (at + REST).saturating_duration_since(now)),
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_rests_while_it_is_processed_and_after() {
        let activity = Activity::default();
        let path = Path::new("a.glb");
        let rest = || activity.rest(path, Instant::now());
        assert_eq!(rest(), Duration::ZERO);
        let (one, two) = (activity.processing(path), activity.processing(path));
        drop(one);
        assert_eq!(activity.rest(path, Instant::now() + REST * 2), REST);
        drop(two);
        assert!(rest() > Duration::ZERO && rest() <= REST);
        assert_eq!(activity.rest(path, Instant::now() + REST), Duration::ZERO);
        assert_eq!(activity.rest(Path::new("b.glb"), Instant::now()), Duration::ZERO);
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
