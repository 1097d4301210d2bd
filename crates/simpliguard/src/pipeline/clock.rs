//! Seconds per stage.

use std::sync::Mutex;
use std::time::Instant;

use crate::StageId;

/// Sums the time spent in each stage, over threads.
#[derive(Default)]
pub(crate) struct Clock(Mutex<Vec<(StageId, f64)>>);

impl Clock {
    pub(crate) fn time<T>(&self, stage: StageId, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = work();
        let seconds = start.elapsed().as_secs_f64();
        // A panic elsewhere leaves the sums usable.
        let mut sums = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        match sums.iter_mut().find(|(s, _)| *s == stage) {
            Some((_, sum)) => *sum += seconds,
            None => sums.push((stage, seconds)),
        }
        out
    }

    /// By stage name, in the chain's order.
    pub(crate) fn seconds(&self) -> Vec<(String, f64)> {
        let mut sums = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone();
        sums.sort_by_key(|(stage, _)| *stage);
        sums.into_iter().map(|(stage, seconds)| (stage.to_string(), seconds)).collect()
    }
}
