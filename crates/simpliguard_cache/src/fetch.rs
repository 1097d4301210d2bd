//! A result on its way from the shared tier, while the caller waits or makes the result itself.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Instant;

use crate::flight::Flight;
use crate::record::Entry;
use crate::requests::{HEAD_START, LOOK};
use crate::shared::Shared;

/// A look-up in the shared tier, on a thread of its own. If the tier hangs, the thread does, and nobody waits for it.
pub(crate) struct Fetch {
    entry: Receiver<Entry>,
    has_arrived: Arc<AtomicBool>,
}

impl Fetch {
    /// Begins to look. `None` while the tier is left alone or silent. Failures are left with the tier for whoever asks next.
    pub(crate) fn begin(shared: &Arc<Shared>, flight: &Flight<'_>) -> Option<Self> {
        if !shared.is_answering() {
            return None;
        }
        let (sender, entry) = mpsc::sync_channel(1);
        let has_arrived = Arc::new(AtomicBool::new(false));
        let (shared, key, check, arrived) = (shared.clone(), *flight.key, flight.check, has_arrived.clone());
        let work = move || match shared.get(&key, check) {
            Ok(Some(entry)) => {
                if sender.send(entry).is_ok() {
                    arrived.store(true, Relaxed);
                }
            }
            Ok(None) => {}
            Err(error) => shared.note(error),
        };
        let thread = thread::Builder::new().name("simpliguard look-up".into()).spawn(work);
        thread.ok().map(|_| Self { entry, has_arrived })
    }

    /// Waits for the result, no longer than [`HEAD_START`] for a tier that does not answer.
    pub(crate) fn wait(&self, shared: &Shared, is_cancelled: &dyn Fn() -> bool) -> Option<Entry> {
        let start = Instant::now();
        while start.elapsed() < HEAD_START && shared.longest_wait() < HEAD_START && !is_cancelled() {
            match self.entry.recv_timeout(LOOK) {
                Ok(entry) => return Some(entry),
                Err(RecvTimeoutError::Disconnected) => return None,
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
        None
    }

    /// Set once the result is there.
    pub(crate) fn has_arrived(&self) -> &Arc<AtomicBool> {
        &self.has_arrived
    }

    /// The result, if it is there.
    pub(crate) fn take(&self) -> Option<Entry> {
        self.entry.try_recv().ok()
    }
}
