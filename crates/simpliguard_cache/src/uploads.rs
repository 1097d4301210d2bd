//! Uploads in the background: the next result is made while the last one is stored in the shared tier.

use std::sync::mpsc::{self, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use simpliguard_key::Key;

use crate::error::StorageError;
use crate::flight::Flight;
use crate::record::Entry;
use crate::shared::Shared;

/// Most results that wait to be stored. They are in memory, so whoever makes more waits.
const MOST_WAITING: usize = 2;

/// A thread that stores results in a shared tier.
#[derive(Debug)]
pub(crate) struct Uploads {
    /// `None` after the last result.
    queue: Mutex<Option<SyncSender<(Key, Entry)>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    errors: Arc<Mutex<Vec<StorageError>>>,
}

impl Uploads {
    /// Starts the thread. `None` if the system has no thread left.
    pub(crate) fn start(shared: Arc<Shared>) -> Option<Self> {
        let (queue, results) = mpsc::sync_channel::<(Key, Entry)>(MOST_WAITING);
        let errors = Arc::default();
        let failed: Arc<Mutex<Vec<StorageError>>> = Arc::clone(&errors);
        let work = move || {
            for (key, entry) in results {
                let flight = Flight { key: &key, is_cancelled: &|| false, notify: &|_| {}, check: &|_| Ok(()) };
                if let Err(error) = shared.put(&flight, entry) {
                    failed.lock().unwrap_or_else(PoisonError::into_inner).push(error);
                }
            }
        };
        let thread = thread::Builder::new().name("simpliguard uploads".into()).spawn(work).ok()?;
        Some(Self { queue: Mutex::new(Some(queue)), thread: Mutex::new(Some(thread)), errors })
    }

    /// Stores a result soon. Gives it back if the thread has ended.
    pub(crate) fn push(&self, key: Key, entry: Entry) -> Result<(), Entry> {
        let queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match queue {
            Some(queue) => queue.send((key, entry)).map_err(|back| back.0.1),
            None => Err(entry),
        }
    }

    /// The failures since the last call.
    pub(crate) fn errors(&self) -> Vec<StorageError> {
        std::mem::take(&mut *self.errors.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Waits until all results are stored. Returns the failures since the last call of [`Self::errors`].
    pub(crate) fn finish(&self) -> Vec<StorageError> {
        drop(self.queue.lock().unwrap_or_else(PoisonError::into_inner).take());
        if let Some(thread) = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take() {
            let _ = thread.join();
        }
        self.errors()
    }
}
