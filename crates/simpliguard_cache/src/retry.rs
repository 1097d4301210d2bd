//! Retries of file operations that fail while another program has the file open.
//!
//! Only Windows has such failures: a game that reads a file, or a virus scanner, keeps others from opening or replacing
//! it.

use std::io::{self, ErrorKind};
use std::thread;
use std::time::Duration;

/// Code of Windows: another program has the file open and does not share it.
const ERROR_SHARING_VIOLATION: i32 = 32;
/// Code of Windows: another program has locked a part of the file.
const ERROR_LOCK_VIOLATION: i32 = 33;

/// Shortest and longest pause between two tries. A pause is twice as long as the one before it, so all of them together
/// take 2.5 seconds: a game reads a large model in less.
const PAUSES: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(1280)];

/// The pauses between the tries of one operation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Backoff {
    is_transient: fn(&io::Error) -> bool,
    pause: Duration,
}

impl Backoff {
    /// For reading a file.
    pub(crate) fn for_reading() -> Self {
        Self::new(|error| cfg!(windows) && is_violation(error))
    }

    /// For replacing or removing a file. Windows then also denies the access if the file is open.
    pub(crate) fn for_replacing() -> Self {
        Self::new(|error| cfg!(windows) && (is_violation(error) || error.kind() == ErrorKind::PermissionDenied))
    }

    fn new(is_transient: fn(&io::Error) -> bool) -> Self {
        Self { is_transient, pause: PAUSES[0] }
    }

    /// Pauses before the next try. `Err` if another try is in vain, or if there were enough of them.
    pub(crate) fn pause_after(&mut self, error: io::Error) -> io::Result<()> {
        if !(self.is_transient)(&error) || self.pause > PAUSES[1] {
            return Err(error);
        }
        thread::sleep(self.pause);
        self.pause *= 2;
        Ok(())
    }

    /// Calls `act` until it succeeds, or fails for good.
    pub(crate) fn retry<T>(mut self, mut act: impl FnMut() -> io::Result<T>) -> io::Result<T> {
        loop {
            match act() {
                Err(error) => self.pause_after(error)?,
                done => return done,
            }
        }
    }

    /// As on Windows, for tests on other systems.
    #[cfg(test)]
    pub(crate) fn of_windows() -> Self {
        Self::new(is_violation)
    }
}

/// Tells whether another program has the file open, by the codes of Windows. They have no [`ErrorKind`] of their own.
fn is_violation(error: &io::Error) -> bool {
    matches!(error.raw_os_error(), Some(ERROR_SHARING_VIOLATION | ERROR_LOCK_VIOLATION))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An operation that fails `times` times.
    fn failing(code: i32, times: u32) -> impl FnMut() -> io::Result<u32> {
        let mut tries = 0;
        move || {
            tries += 1;
            if tries > times { Ok(tries) } else { Err(io::Error::from_raw_os_error(code)) }
        }
    }

    #[test]
    fn files_that_others_have_open_are_tried_again() {
        for code in [32, 33] {
            assert_eq!(Backoff::of_windows().retry(failing(code, 3)).expect("succeeds at last"), 4);
        }
    }

    #[test]
    fn retries_end() {
        let error = Backoff::of_windows().retry(failing(32, 100)).expect_err("stays open");
        assert_eq!(error.raw_os_error(), Some(32));
    }

    #[test]
    fn other_failures_are_final() {
        let mut calls = 0;
        let mut act = || {
            calls += 1;
            failing(2, 9)()
        };
        assert!(Backoff::of_windows().retry(&mut act).is_err());
        #[cfg(not(windows))]
        assert!(Backoff::for_replacing().retry(|| failing(32, 9)()).is_err());
        assert_eq!(calls, 1);
    }
}
