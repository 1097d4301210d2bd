//! How long a device that a game draws with may work for bakes in each frame.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::error::GpuError;

/// The length of a frame.
const FRAME: Duration = Duration::from_micros(16_667);
/// Least work in a frame. With less, a bake would take hours.
const LEAST: Duration = Duration::from_micros(100);

/// The work of all threads of a program on one device, one submission after another where it is limited.
#[derive(Default)]
pub(crate) struct Pace(Mutex<Frame>);

/// A frame's worth of time, and the work in it.
#[derive(Default)]
struct Frame {
    /// Most work in a frame; `None` if there is no limit.
    limit: Option<Duration>,
    /// The first work in this frame.
    start: Option<Instant>,
    work: Duration,
}

impl Pace {
    /// Limits the work in each frame, to a tenth of a millisecond at least, or lifts the limit.
    pub(crate) fn set_limit(&self, limit: Option<Duration>) {
        self.lock().limit = limit.map(|limit| limit.max(LEAST));
    }

    /// Submits work with `submit`. With a limit, waits until the frame has time left for it, and until it is done: by
    /// `finish`.
    pub(crate) fn run<T>(
        &self,
        submit: impl FnOnce() -> Result<T, GpuError>,
        finish: impl FnOnce(&T) -> Result<(), GpuError>,
    ) -> Result<T, GpuError> {
        let mut frame = self.lock();
        if frame.limit.is_none() {
            drop(frame);
            return submit();
        }
        std::thread::sleep(frame.pause(Instant::now()));
        let start = Instant::now();
        let submitted = submit()?;
        finish(&submitted)?;
        frame.add(start, start.elapsed());
        Ok(submitted)
    }

    fn lock(&self) -> MutexGuard<'_, Frame> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Frame {
    /// The wait before more work. Work that took longer than the limit is followed by a longer pause.
    fn pause(&self, now: Instant) -> Duration {
        let (Some(limit), Some(start)) = (self.limit, self.start) else { return Duration::ZERO };
        if self.work < limit {
            return Duration::ZERO;
        }
        let frames = self.work.div_duration_f64(limit);
        FRAME.mul_f64(frames).saturating_sub(now.duration_since(start))
    }

    /// Counts work, in the next frame if this one is over or full.
    fn add(&mut self, start: Instant, work: Duration) {
        let is_over = |frame: &Self, limit| {
            frame.work >= limit || frame.start.is_none_or(|first| start.duration_since(first) >= FRAME)
        };
        if self.limit.is_some_and(|limit| is_over(self, limit)) {
            (self.start, self.work) = (Some(start), Duration::ZERO);
        }
        self.work += work;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// The pauses before pieces of work, in milliseconds, rounded.
    fn pauses(limit: Option<Duration>, work: &[u32]) -> Vec<u128> {
        let mut frame = Frame { limit, ..Frame::default() };
        let mut now = Instant::now();
        let pause = |&ms: &u32| {
            let pause = frame.pause(now);
            now += pause;
            frame.add(now, ms * MS);
            now += ms * MS;
            (pause + MS / 2).as_millis()
        };
        work.iter().map(pause).collect()
    }

    #[test]
    fn a_full_frame_is_waited_for() {
        // Two and two milliseconds fill a frame of four, of which 12.7 are left.
        assert_eq!(pauses(Some(4 * MS), &[2, 2, 2, 2, 2]), [0, 0, 13, 0, 13]);
    }

    #[test]
    fn work_that_is_too_long_is_followed_by_as_many_frames() {
        // Twelve milliseconds are the work of three frames of four.
        assert_eq!(pauses(Some(4 * MS), &[12, 4, 4]), [0, 38, 13]);
    }

    #[test]
    fn no_time_at_all_is_a_tenth_of_a_millisecond() {
        let pace = Pace::default();
        pace.set_limit(Some(Duration::ZERO));
        let limit = pace.lock().limit;
        assert_eq!((limit, pauses(limit, &[1, 1])), (Some(MS / 10), vec![0, 166]));
    }

    #[test]
    fn without_a_limit_there_is_no_pause() {
        assert_eq!(pauses(None, &[100, 100]), [0, 0]);
    }
}
