//! The time limit of one model.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use simpliguard::{Cancellation, Error, Progress, ProgressSink, StageId};

/// Passes progress on and knows the last stage.
pub(crate) struct LastStage<'a> {
    next: &'a dyn ProgressSink,
    stage: Mutex<StageId>,
}

impl<'a> LastStage<'a> {
    pub(crate) fn new(next: &'a dyn ProgressSink) -> Self {
        Self { next, stage: Mutex::new(StageId::Import) }
    }

    fn get(&self) -> StageId {
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ProgressSink for LastStage<'_> {
    fn report(&self, progress: Progress) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        *stage = progress.stage.max(*stage);
        drop(stage);
        self.next.report(progress);
    }
}

/// Runs `work`, and cancels it after `limit`. Work that ends because of that is [`Error::Invalid`], with the stage that
/// it was in.
pub(crate) fn within<T>(
    limit: Option<Duration>,
    (asset, stage): (&str, &LastStage<'_>),
    cancellation: &Cancellation,
    work: impl FnOnce() -> Result<T, Error>,
) -> Result<T, Error> {
    let Some(limit) = limit else { return work() };
    let result = thread::scope(|scope| {
        // The end of the work drops the sender, which wakes the watch.
        let (_done, end) = mpsc::channel::<()>();
        scope.spawn(move || {
            if end.recv_timeout(limit) == Err(RecvTimeoutError::Timeout) {
                cancellation.cancel();
            }
        });
        work()
    });
    match result {
        Err(Error::Cancelled { .. }) if cancellation.is_cancelled() => {
            let found = format!("it is not done after {}", humantime::format_duration(limit));
            let advice = "give it more time with --timeout, or reduce the model";
            Err(Error::invalid(asset, stage.get(), found, advice))
        }
        result => result,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    struct Nobody;

    impl ProgressSink for Nobody {
        fn report(&self, _: Progress) {}
    }

    #[test]
    fn work_that_takes_too_long_is_cancelled_and_its_stage_named() {
        let (stage, cancellation) = (LastStage::new(&Nobody), Cancellation::default());
        let work = || {
            stage.report(Progress { stage: StageId::Simplify, level: None, fraction: 0.5 });
            while !cancellation.is_cancelled() {
                thread::sleep(Duration::from_millis(1));
            }
            cancellation.check("fox.glb")
        };
        let limit = Some(Duration::from_millis(20));
        let error = within(limit, ("fox.glb", &stage), &cancellation, work).expect_err("cancelled");
        assert_eq!(
            error.to_string(),
            "fox.glb: simplify: it is not done after 20ms; give it more time with --timeout, or reduce the model"
        );
    }

    #[test]
    fn work_in_time_is_not_waited_for() {
        let (stage, cancellation) = (LastStage::new(&Nobody), Cancellation::default());
        let start = Instant::now();
        for limit in [None, Some(Duration::from_secs(60))] {
            assert_eq!(within(limit, ("fox.glb", &stage), &cancellation, || Ok(7)).expect("done"), 7);
        }
        assert!(!cancellation.is_cancelled() && start.elapsed() < Duration::from_secs(30));
    }
}
