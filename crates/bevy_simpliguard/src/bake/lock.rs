//! The lock of the processor: of several games that run on one folder, only the first processes assets.
//!
//! Bevy's processor expects to be alone: it empties its log at the start, and writes a processed file for each change.
//! A game that starts later reads the files that the first one processes.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;

use bevy::asset::AssetPath;
use bevy::asset::processor::{LogEntry, ProcessorTransactionLog, ProcessorTransactionLogFactory};
use bevy::ecs::error::BevyError;
use bevy::prelude::*;
use bevy::tasks::BoxedFuture;

/// Path of the lock file, relative to the base of all asset folders. It is beside Bevy's log, whose place is fixed too.
const PATH: &str = "imported_assets/.simpliguard/lock";

/// The right to process the assets of a folder, until it is dropped or the process ends.
#[derive(Resource, Debug)]
pub(super) struct ProcessorLock(Result<Option<File>, String>);

impl ProcessorLock {
    /// Takes the lock below `base`, if no other process has it.
    pub(super) fn take(base: &Path) -> Self {
        let path = base.join(PATH);
        Self(match open(&path).map(|file| (file.try_lock(), file)) {
            Ok((Ok(()), file)) => Ok(Some(file)),
            Ok((Err(TryLockError::WouldBlock), _)) => {
                Err("another game processes the same assets; its results are used".to_owned())
            }
            // The file system has no locks. Go on without.
            Ok((Err(TryLockError::Error(error)), _)) => {
                debug!("{}: {error}", path.display());
                Ok(None)
            }
            Err(error) => Err(format!("{}: {error}", path.display())),
        })
    }

    /// Tells whether this game processes.
    pub(super) fn is_ours(&self) -> bool {
        self.0.is_ok()
    }

    /// The reason why this game does not process. `None` if it does.
    pub(super) fn refusal(&self) -> Option<&str> {
        self.0.as_ref().err().map(String::as_str)
    }
}

fn open(path: &Path) -> io::Result<File> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    File::options().create(true).write(true).truncate(false).open(path)
}

/// The transaction log of a processor that processes nothing.
pub(super) struct NoLog;

impl ProcessorTransactionLogFactory for NoLog {
    fn read(&self) -> BoxedFuture<'_, Result<Vec<LogEntry>, BevyError>> {
        Box::pin(async { Ok(Vec::new()) })
    }

    fn create_new_log(&self) -> BoxedFuture<'_, Result<Box<dyn ProcessorTransactionLog>, BevyError>> {
        Box::pin(async { Ok(Box::new(Self) as Box<dyn ProcessorTransactionLog>) })
    }
}

impl ProcessorTransactionLog for NoLog {
    fn begin_processing<'a>(&'a mut self, _: &'a AssetPath<'_>) -> BoxedFuture<'a, Result<(), BevyError>> {
        Box::pin(async { Ok(()) })
    }

    fn end_processing<'a>(&'a mut self, _: &'a AssetPath<'_>) -> BoxedFuture<'a, Result<(), BevyError>> {
        Box::pin(async { Ok(()) })
    }

    fn unrecoverable(&mut self) -> BoxedFuture<'_, Result<(), BevyError>> {
        Box::pin(async { Ok(()) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_at_a_time_processes() {
        let dir = tempfile::tempdir().expect("tempdir");
        let first = ProcessorLock::take(dir.path());
        assert!(first.is_ours() && first.refusal().is_none());
        let second = ProcessorLock::take(dir.path());
        assert!(!second.is_ours() && second.refusal().is_some_and(|why| why.contains("another game")));
        drop(first);
        assert!(!second.is_ours());
        assert!(ProcessorLock::take(dir.path()).is_ours());
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_not_processed() {
        let dir = tempfile::tempdir().expect("tempdir");
        fs::write(dir.path().join("imported_assets"), "a file").expect("writes");
        assert!(ProcessorLock::take(dir.path()).refusal().is_some_and(|why| why.contains(".simpliguard")));
    }
}
