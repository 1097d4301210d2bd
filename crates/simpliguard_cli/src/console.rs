//! Messages and progress for the user. All of them go to stderr.

use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use simpliguard::{Printable, Progress, ProgressSink, StageId};

/// Number of steps of a full bar.
const BAR_STEPS: u64 = 1000;
/// Fraction of a bake after which a line follows though its stage has had one.
const FRACTION_PER_LINE: f32 = 0.1;

/// Prints one or more lines. A closed stderr is no reason to stop.
pub(crate) fn line(text: &str) {
    let _ = writeln!(io::stderr(), "{}", printable_lines(text));
}

pub(crate) fn error(text: &str) {
    line(&format!("error: {}", Printable(text)));
}

pub(crate) fn warning(text: &str) {
    line(&format!("warning: {}", Printable(text)));
}

/// A text of several lines, each as [`Printable`] shows it.
pub(crate) fn printable_lines(text: &str) -> String {
    text.split('\n').map(|line| Printable(line).to_string()).collect::<Vec<_>>().join("\n")
}

/// Progress of one model: a bar on a terminal; otherwise a line for each stage and for each further tenth.
pub(crate) struct AssetProgress {
    label: String,
    bar: Option<ProgressBar>,
    announced: Mutex<Announced>,
}

/// What the lines of a model have said.
#[derive(Default)]
struct Announced {
    /// The latest stage with a line.
    stage: Option<StageId>,
    /// Fraction of the bake at the last line.
    fraction: f32,
}

impl Announced {
    /// True if this progress is worth a line. Levels run in parallel and objects one after the other, so a stage may be
    /// reported again; a scene of many objects still shows that it moves on.
    fn is_news(&mut self, stage: StageId, fraction: f32) -> bool {
        let is_new_stage = self.stage.is_none_or(|latest| stage > latest);
        if !is_new_stage && fraction < self.fraction + FRACTION_PER_LINE {
            return false;
        }
        *self = Self { stage: self.stage.max(Some(stage)), fraction };
        true
    }
}

impl AssetProgress {
    /// `number` counts from 1 to `total`.
    pub(crate) fn new(number: usize, total: usize, name: &str) -> Self {
        let label = format!("[{number}/{total}] {}", Printable(name));
        let bar = io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(BAR_STEPS).with_style(style()).with_prefix(label.clone());
            bar.enable_steady_tick(Duration::from_millis(100));
            bar
        });
        Self { label, bar, announced: Mutex::default() }
    }

    /// Shows a note while the bake runs.
    pub(crate) fn note(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.set_message(Printable(text).to_string()),
            None => line(&format!("{}: {text}", self.label)),
        }
    }

    /// Removes the bar and prints the outcome.
    pub(crate) fn finish(self, outcome: &str) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        line(&format!("{}: {outcome}", self.label));
    }
}

impl ProgressSink for AssetProgress {
    fn report(&self, Progress { stage, level, fraction }: Progress) {
        if let Some(bar) = &self.bar {
            bar.set_position((fraction.clamp(0.0, 1.0) * BAR_STEPS as f32) as u64);
            bar.set_message(level.map_or(stage.to_string(), |level| format!("{stage} LOD{level}")));
            return;
        }
        let mut announced = self.announced.lock().unwrap_or_else(PoisonError::into_inner);
        if announced.is_news(stage, fraction) {
            line(&format!("{}: {stage} ({:.0} %)", self.label, fraction * 100.0));
        }
    }
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{prefix} {bar:24} {percent:>3} % {msg} {elapsed}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_has_one_line_and_so_has_each_further_tenth() {
        let mut announced = Announced::default();
        let mut news = |stage, percent: u8| announced.is_news(stage, f32::from(percent) / 100.0);
        assert!(news(StageId::Import, 0));
        assert!(news(StageId::Maps, 2));
        // The next object begins anew.
        assert!(!news(StageId::Import, 4));
        assert!(!news(StageId::Maps, 6));
        assert!(news(StageId::Simplify, 13));
        assert!(!news(StageId::Maps, 15));
        assert!(news(StageId::Export, 16));
        assert!(news(StageId::Maps, 27));
    }
}
