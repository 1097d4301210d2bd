//! How far a bake is, from the weights of the stages.

use std::sync::{Mutex, PoisonError};

use super::context::{Progress, ProgressSink};
use super::stage::Stage;
use crate::StageId;

/// Passes the progress of a bake on to its sink. The fraction never falls.
pub(super) struct Meter<'a> {
    sink: &'a dyn ProgressSink,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// Fraction that was reported last.
    reported: f32,
    /// Fraction of each level, as if it were the only one.
    levels: Vec<f32>,
}

impl<'a> Meter<'a> {
    pub(super) fn new(sink: &'a dyn ProgressSink) -> Self {
        Self { sink, state: Mutex::default() }
    }

    /// Announces the number of levels. Together they are as far as their mean, whether they run side by side or one after
    /// the other.
    pub(super) fn expect_levels(&self, count: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.levels = vec![state.reported; count];
    }

    /// A stage begins, for `level` counted from 1 or for the whole model.
    pub(super) fn begin(&self, stage: StageId, level: Option<usize>) {
        self.report(stage, level, Stage::begins_at(stage));
    }

    /// Everything is done.
    pub(super) fn finish(&self) {
        self.report(StageId::Export, None, 1.0);
    }

    fn report(&self, stage: StageId, level: Option<usize>, begins_at: f32) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let levels = &mut state.levels;
        let fraction = match level.and_then(|level| levels.get_mut(level.checked_sub(1)?)) {
            Some(own) => {
                *own = own.max(begins_at);
                levels.iter().sum::<f32>() / levels.len() as f32
            }
            None => begins_at,
        };
        state.reported = state.reported.max(fraction);
        // Under the lock, so that no report overtakes another.
        self.sink.report(Progress { stage, level, fraction: state.reported });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Fractions(Mutex<Vec<f32>>);

    impl ProgressSink for Fractions {
        fn report(&self, progress: Progress) {
            self.0.lock().expect("not poisoned").push(progress.fraction);
        }
    }

    #[test]
    fn levels_count_by_their_mean_and_nothing_falls() {
        let sink = Fractions::default();
        let meter = Meter::new(&sink);
        meter.begin(StageId::Simplify, None);
        meter.begin(StageId::Reconstruct, None);
        meter.expect_levels(2);
        meter.begin(StageId::Refine, Some(1));
        meter.begin(StageId::Unwrap, Some(2));
        meter.begin(StageId::Export, None);
        meter.finish();
        let [simplify, unwrap, refine] = [StageId::Simplify, StageId::Unwrap, StageId::Refine].map(Stage::begins_at);
        let expected = [
            simplify,
            simplify,
            (refine + simplify) / 2.0,
            (refine + unwrap) / 2.0,
            Stage::begins_at(StageId::Export),
            1.0,
        ];
        assert_eq!(*sink.0.lock().expect("not poisoned"), expected);
    }
}
