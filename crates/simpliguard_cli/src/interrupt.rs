//! Ctrl-C: the command ends at once, but not in the middle of writing a file.

use std::process;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use crate::console;

const EXIT_CODE: i32 = 130;
/// Longest time that an interrupt waits for a write.
const PATIENCE: Duration = Duration::from_millis(800);

/// Guards writes against interrupts.
#[derive(Clone, Default)]
pub(crate) struct Interrupt(Arc<Mutex<()>>);

impl Interrupt {
    /// Handles Ctrl-C and the signals that ask a process to end.
    pub(crate) fn install() -> Self {
        let interrupt = Self::default();
        let handler = interrupt.clone();
        if let Err(e) = ctrlc::set_handler(move || handler.exit()) {
            console::warning(&format!("Ctrl-C may leave temporary files: {e}"));
        }
        interrupt
    }

    /// Lets an interrupt wait until the guard is dropped.
    pub(crate) fn hold(&self) -> MutexGuard<'_, ()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn exit(&self) {
        let start = Instant::now();
        // Held until the process has ended, so that no new write begins.
        let _guard = loop {
            match self.0.try_lock() {
                Ok(guard) => break Some(guard),
                Err(TryLockError::Poisoned(guard)) => break Some(guard.into_inner()),
                Err(TryLockError::WouldBlock) if start.elapsed() > PATIENCE => break None,
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        console::line("\ninterrupted; finished models are written");
        process::exit(EXIT_CODE);
    }
}
