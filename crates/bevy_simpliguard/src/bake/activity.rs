//! The activity around processed files: reading, processing and swapping, and the changes that the game has seen.

use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use async_io::Timer;
use bevy::platform::collections::HashMap;

use super::timing::{PATIENCE, TICK};

/// Longest time between two steps of the processor that can be seen from here, and longest time that those who wait for
/// its lock need to get it.
const REST: Duration = Duration::from_secs(1);

/// The activity around the processed files of a source, by their paths below it.
#[derive(Debug, Default)]
pub(super) struct ProcessorActivity(Mutex<HashMap<PathBuf, Record>>);

#[derive(Debug, Default)]
struct Record {
    /// Number of processors at work on the file.
    processors: usize,
    /// Number of its readers.
    readers: usize,
    /// Number of swaps of the file.
    swaps: usize,
    /// Time of the last write.
    written: Option<Instant>,
    /// Time of the last read, and the version of the file that was read.
    read: Option<(Instant, Stamp)>,
    /// The processor's last step with its lock.
    lock: Option<(Lock, Instant)>,
}

/// A step of the processor with the lock of a processed file; see [`super::readers`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lock {
    /// It asks for the lock, or has found nothing to do.
    Claimed,
    /// It holds the lock, or has failed.
    Held,
    /// It gives the lock back.
    Released,
}

impl Record {
    fn is_at(&self, step: Lock, now: Instant) -> bool {
        let span = if step == Lock::Held { PATIENCE } else { REST };
        self.lock.is_some_and(|(last, since)| last == step && now < since + span)
    }

    /// Tells whether the processor may ask for the lock.
    fn is_free(&self, now: Instant) -> bool {
        let is_locked = [Lock::Claimed, Lock::Held, Lock::Released].iter().any(|step| self.is_at(*step, now));
        self.processors + self.readers + self.swaps == 0 && !is_locked
    }

    /// Tells whether the processor may be about to write the file.
    fn is_processed(&self, now: Instant) -> bool {
        self.processors > 0 || [Lock::Claimed, Lock::Held].iter().any(|step| self.is_at(*step, now))
    }
}

/// Tells versions of a file apart without reading it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stamp([Option<(u64, SystemTime)>; 2]);

impl Stamp {
    /// The version of a file and its `.meta`.
    pub(super) fn of(file: &Path) -> Self {
        let mut meta = file.as_os_str().to_owned();
        meta.push(".meta");
        let stamp = |m: Metadata| Some((m.len(), m.modified().ok()?));
        Self([file, Path::new(&meta)].map(|path| fs::metadata(path).ok().and_then(stamp)))
    }
}

impl ProcessorActivity {
    /// Records that a model is being processed, until the guard is dropped.
    pub(super) fn processing(self: &Arc<Self>, path: &Path) -> Guard {
        self.update(path, |record| record.processors += 1);
        self.guard(path, |record| {
            record.processors -= 1;
            record.written = Some(Instant::now());
        })
    }

    /// Records that a processed file, or its `.meta`, is being read, until the guard is dropped.
    pub(super) fn reading(self: &Arc<Self>, path: &Path) -> Guard {
        self.update(path, |record| record.readers += 1);
        self.guard(path, |record| record.readers -= 1)
    }

    /// Records that a processed file is being swapped, until the guard is dropped. The processor does not write it
    /// meanwhile. `None` while the processor may be about to write it.
    pub(super) fn swapping(self: &Arc<Self>, path: &Path, now: Instant) -> Option<Guard> {
        let is_begun = self.update(path, |record| {
            let is_begun = !record.is_processed(now);
            record.swaps += usize::from(is_begun);
            is_begun
        });
        is_begun.then(|| self.guard(path, |record| record.swaps -= 1))
    }

    /// Waits until no swap of a processed file is under way. Call it after a step that keeps new swaps away:
    /// [`Self::processing`] or [`Self::held`].
    pub(super) async fn swap_ended(&self, path: &Path) {
        while self.lock().get(path).is_some_and(|record| record.swaps > 0) {
            Timer::after(TICK).await;
        }
    }

    /// Records a write of a processed file.
    pub(super) fn wrote(&self, path: &Path) {
        self.update(path, |record| record.written = Some(Instant::now()));
    }

    /// Lets the processor ask for the lock of a processed file. `false` if it has to wait.
    pub(super) fn claim(&self, path: &Path, now: Instant) -> bool {
        self.update(path, |record| {
            let is_free = record.is_free(now);
            if is_free {
                record.lock = Some((Lock::Claimed, now));
            }
            is_free
        })
    }

    /// Tells whether the processor asks for the lock of a processed file.
    pub(super) fn is_claimed(&self, path: &Path, now: Instant) -> bool {
        self.lock().get(path).is_some_and(|record| record.is_at(Lock::Claimed, now))
    }

    /// Records that the processor looks at the source of a processed file again. If its last look has found nothing to do,
    /// that is known now: the next reader of the source is not the second one of that look.
    pub(super) fn looked_at(&self, path: &Path) {
        self.update(path, |record| {
            if let Some((lock @ Lock::Claimed, since)) = &mut record.lock {
                (*lock, *since) = (Lock::Released, Instant::now());
            }
        });
    }

    /// Records that the processor has the lock of a processed file.
    pub(super) fn held(&self, path: &Path) {
        self.update(path, |record| record.lock = Some((Lock::Held, Instant::now())));
    }

    /// Records that the processor gives the lock of a processed file back.
    pub(super) fn released(&self, path: &Path) {
        self.update(path, |record| record.lock = Some((Lock::Released, Instant::now())));
    }

    /// Tells whether Bevy may be told of a change to the source of a processed file.
    pub(super) fn is_free(&self, path: &Path, now: Instant) -> bool {
        self.lock().get(path).is_none_or(|record| record.is_free(now))
    }

    /// Records that a processed file, at `file`, is about to be read.
    pub(super) fn read(&self, path: &Path, file: &Path) {
        let stamp = Stamp::of(file);
        self.update(path, |record| record.read = Some((Instant::now(), stamp)));
    }

    /// Tells whether the processed file at `file` has changed since the last read.
    pub(super) fn is_news(&self, path: &Path, file: &Path) -> bool {
        let stamp = Stamp::of(file);
        let records = self.lock();
        let Some(Record { read: Some((at, seen)), written, .. }) = records.get(path) else { return true };
        written.is_some_and(|written| written >= *at) || stamp != *seen
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<PathBuf, Record>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn update<T>(&self, path: &Path, update: impl FnOnce(&mut Record) -> T) -> T {
        update(self.lock().entry(path.to_owned()).or_default())
    }

    fn guard(self: &Arc<Self>, path: &Path, end: fn(&mut Record)) -> Guard {
        Guard { activity: self.clone(), path: path.to_owned(), end }
    }
}

/// Ends an activity on drop.
#[derive(Debug)]
pub(super) struct Guard {
    activity: Arc<ProcessorActivity>,
    path: PathBuf,
    end: fn(&mut Record),
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.activity.update(&self.path, self.end);
    }
}

#[cfg(test)]
mod tests {
    use bevy::tasks::block_on;

    use super::*;

    #[test]
    fn a_file_is_free_when_nobody_reads_or_processes_it() {
        let activity = Arc::new(ProcessorActivity::default());
        let path = Path::new("a.glb");
        let (start, soon) = (Instant::now(), || Instant::now() + REST);
        assert!(activity.is_free(path, start));
        let (one, two) = (activity.reading(path), activity.reading(path));
        drop(one);
        assert!(!activity.claim(path, soon()) && activity.is_free(Path::new("b.glb"), start));
        drop(two);
        // A claim without a next step ends after a while.
        assert!(activity.claim(path, start) && !activity.claim(path, start) && activity.is_claimed(path, start));
        assert!(activity.is_free(path, soon()) && activity.claim(path, soon()));
        // A second look of the processor ends the claim of the first, which may still be on its way to the lock.
        activity.looked_at(path);
        assert!(!activity.is_claimed(path, start) && !activity.claim(path, start) && activity.claim(path, soon()));
        activity.held(path);
        activity.looked_at(path);
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
    fn a_file_is_either_swapped_or_processed() {
        let activity = Arc::new(ProcessorActivity::default());
        let (path, now) = (Path::new("a.glb"), Instant::now());
        let swapping = activity.swapping(path, now).expect("free");
        assert!(!activity.claim(path, now));
        drop(swapping);
        assert!(activity.claim(path, now) && activity.swapping(path, now).is_none());
        assert!(activity.swapping(path, now + REST).is_some(), "the processor has found nothing to do");
        activity.held(path);
        assert!(activity.swapping(path, now).is_none());
        activity.released(path);
        assert!(activity.swapping(path, now).is_some());
        let processing = activity.processing(path);
        assert!(activity.swapping(path, now).is_none());
        drop(processing);
        assert!(activity.swapping(path, now).is_some());
    }

    #[test]
    fn the_processor_waits_for_the_end_of_a_swap_but_not_for_readers() {
        let activity = Arc::new(ProcessorActivity::default());
        let path = Path::new("a.glb");
        let (swapping, _reading) = (activity.swapping(path, Instant::now()).expect("free"), activity.reading(path));
        // A slow processor, whose claim has run out before the swap began.
        activity.held(path);
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| block_on(activity.swap_ended(path)));
            std::thread::sleep(TICK * 3);
            assert!(!waits.is_finished());
            assert!(activity.swapping(path, Instant::now()).is_none(), "no other swap begins");
            drop(swapping);
            waits.join().expect("no panic");
        });
        block_on(activity.swap_ended(Path::new("b.glb")));
    }

    #[test]
    fn what_was_read_since_it_was_written_is_no_news() {
        let dir = tempfile::tempdir().expect("tempdir");
        let (path, file) = (Path::new("a.glb"), dir.path().join("a.glb"));
        let activity = ProcessorActivity::default();
        fs::write(&file, "1").expect("writes");
        activity.wrote(path);
        assert!(activity.is_news(path, &file));
        activity.read(path, &file);
        assert!(!activity.is_news(path, &file));
        activity.wrote(path);
        assert!(activity.is_news(path, &file));
        activity.read(path, &file);
        // Written by somebody else.
        fs::write(&file, "12").expect("writes");
        assert!(activity.is_news(path, &file));
        activity.read(path, &file);
        fs::write(dir.path().join("a.glb.meta"), "()").expect("writes");
        assert!(activity.is_news(path, &file));
    }
}
