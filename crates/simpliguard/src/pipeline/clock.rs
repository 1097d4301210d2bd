//! Seconds per stage.

use std::cell::Cell;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use super::report::StageSeconds;
use super::stage::STAGES;
use crate::StageId;

thread_local! {
    /// Seconds of the stages that have run within the stage that is running on this thread.
    static WITHIN: Cell<f64> = const { Cell::new(0.0) };
}

/// Sums the time of each stage over threads. A stage that runs within another counts for itself alone.
#[derive(Default)]
pub(super) struct Clock(Mutex<[Option<f64>; STAGES.len()]>);

impl Clock {
    pub(super) fn time<T>(&self, stage: StageId, work: impl FnOnce() -> T) -> T {
        let before = WITHIN.replace(0.0);
        let start = Instant::now();
        let out = work();
        let seconds = start.elapsed().as_secs_f64();
        let within = WITHIN.replace(before + seconds);
        // A panic elsewhere leaves the sums usable.
        let mut sums = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *sums[stage as usize].get_or_insert_default() += seconds - within;
        out
    }

    /// Seconds of the stages that have run, in their order.
    pub(super) fn seconds(&self) -> StageSeconds {
        let sums = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let ran = STAGES.iter().zip(*sums).filter_map(|(stage, seconds)| Some((stage.id.to_string(), seconds?)));
        ran.collect()
    }
}

#[cfg(test)]
mod tests {
    use std::thread::sleep;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_stage_within_another_counts_for_itself() {
        let clock = Clock::default();
        clock.time(StageId::Simplify, || {
            clock.time(StageId::Reconstruct, || sleep(Duration::from_millis(60)));
            sleep(Duration::from_millis(5));
        });
        let seconds = clock.seconds();
        let names: Vec<&str> = seconds.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["reconstruct", "simplify"]);
        assert!(seconds[0].1 >= 0.06 && seconds[1].1 >= 0.005 && seconds[1].1 < seconds[0].1, "{seconds:?}");
    }
}
