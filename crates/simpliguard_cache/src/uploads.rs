//! Uploads in the background: the next result is made while the last one is stored in the shared tier.

use std::sync::mpsc::{self, SyncSender, TrySendError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use simpliguard_key::Key;

use crate::flight::Flight;
use crate::record::Entry;
use crate::shared::Shared;

/// Most results that wait to be stored. They are in memory, so whoever makes more waits.
const MOST_WAITING: usize = 2;

/// Time between two looks at the thread.
const PAUSE: Duration = Duration::from_millis(10);

/// A thread that stores results in a shared tier.
#[derive(Debug)]
pub(crate) struct Uploads {
    /// `None` after the last result.
    queue: Mutex<Option<SyncSender<(Key, Entry)>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    shared: Arc<Shared>,
}

impl Uploads {
    /// Starts the thread. `None` if the system has no thread left.
    pub(crate) fn start(shared: Arc<Shared>) -> Option<Self> {
        let (queue, results) = mpsc::sync_channel::<(Key, Entry)>(MOST_WAITING);
        let tier = shared.clone();
        let work = move || {
            for (key, entry) in results {
                let flight = Flight { key: &key, is_cancelled: &|| false, notify: &|_| {}, check: |_| Ok(true) };
                if let Err(error) = tier.put(&flight, entry) {
                    tier.note(error);
                }
            }
        };
        let thread = thread::Builder::new().name("simpliguard uploads".into()).spawn(work).ok()?;
        Some(Self { queue: Mutex::new(Some(queue)), thread: Mutex::new(Some(thread)), shared })
    }

    /// Stores a result soon. Gives it back if the thread has ended, and forgets it while the tier is silent.
    pub(crate) fn push(&self, key: Key, entry: Entry) -> Result<(), Entry> {
        let queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let Some(queue) = queue else { return Err(entry) };
        let mut result = (key, entry);
        loop {
            result = match queue.try_send(result) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Disconnected((_, entry))) => return Err(entry),
                Err(TrySendError::Full(_)) if !self.shared.is_answering() => return Ok(()),
                Err(TrySendError::Full(result)) => result,
            };
            thread::sleep(PAUSE);
        }
    }

    /// Waits until all results are stored, or the tier has fallen silent.
    pub(crate) fn finish(&self) {
        drop(self.queue.lock().unwrap_or_else(PoisonError::into_inner).take());
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        while thread.as_ref().is_some_and(|thread| !thread.is_finished()) && self.shared.is_answering() {
            thread::sleep(PAUSE);
        }
    }
}
