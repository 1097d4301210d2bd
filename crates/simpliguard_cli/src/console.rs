//! Messages and progress for the user. All of them go to stderr.

use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use simpliguard::{Printable, Progress, ProgressSink, StageId};

/// Number of steps of a full bar.
const BAR_STEPS: u64 = 1000;

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

/// Progress of one model: a bar on a terminal, otherwise a line for each stage.
pub(crate) struct AssetProgress {
    label: String,
    bar: Option<ProgressBar>,
    /// The last stage with a line.
    announced: Mutex<Option<StageId>>,
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
        Self { label, bar, announced: Mutex::new(None) }
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
        // Levels run in parallel, so a stage may be reported again. Each gets one line.
        if announced.is_none_or(|last| stage > last) {
            *announced = Some(stage);
            line(&format!("{}: {stage} ({:.0} %)", self.label, fraction * 100.0));
        }
    }
}

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{prefix} {bar:24} {percent:>3} % {msg} {elapsed}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
}
