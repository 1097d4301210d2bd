//! Frame times of a scene that stands still: a warm-up, then a measurement.

use std::time::Duration;

/// What is drawn before a measurement: shaders and textures come late, and frames on their way were begun before.
const WARM_UP: Span = Span { frames: 5, time: Duration::from_secs(5), least: 3 };

/// What is measured.
const MEASURED: Span = Span { frames: 120, time: Duration::from_secs(10), least: 3 };

/// So many frames or so much time, whichever is reached first, but not less than the least of frames.
struct Span {
    frames: usize,
    time: Duration,
    least: usize,
}

impl Span {
    fn is_over(&self, frames: &[Duration]) -> bool {
        let count = frames.len();
        count >= self.frames || count >= self.least && frames.iter().sum::<Duration>() >= self.time
    }
}

/// The frame times of a measurement, in milliseconds.
#[derive(Clone, Copy)]
pub(crate) struct Timing {
    pub(crate) mean: f64,
    /// 95 % of the frames take no longer.
    pub(crate) p95: f64,
}

/// Measures one thing after another.
#[derive(Default)]
pub(crate) struct Timer {
    is_warm: bool,
    frames: Vec<Duration>,
}

impl Timer {
    /// Takes in a frame; the timing once it was the last of a measurement.
    pub(crate) fn add(&mut self, frame: Duration) -> Option<Timing> {
        self.frames.push(frame);
        let span = if self.is_warm { MEASURED } else { WARM_UP };
        if !span.is_over(&self.frames) {
            return None;
        }
        let mut frames = std::mem::take(&mut self.frames);
        self.is_warm = !self.is_warm;
        if self.is_warm {
            return None;
        }
        frames.sort_unstable();
        let (count, total) = (frames.len(), frames.iter().sum::<Duration>());
        let p95 = frames[(count * 95).div_ceil(100) - 1];
        let milliseconds = |time: Duration| 1e3 * time.as_secs_f64();
        Some(Timing { mean: milliseconds(total) / count as f64, p95: milliseconds(p95) })
    }
}
