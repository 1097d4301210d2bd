//! How a run went: one line and one table row for each model, or JSON.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;
use simpliguard::{LevelReport, Report, Status};

use crate::plan::Job;
use crate::{UsageError, console};

/// Version of the JSON document; raised when a field changes its meaning or goes away.
const DOCUMENT_VERSION: u32 = 1;

/// How one model went. Serialises to its entry in the JSON document.
#[derive(Debug, Serialize)]
pub(crate) struct Outcome {
    input: String,
    /// The combined file; null if nothing was written.
    output: Option<String>,
    status: &'static str,
    /// Whether the result was found in the cache.
    cached: bool,
    error: Option<String>,
    levels: Vec<Level>,
    /// The contact sheet; null if there is none.
    sheet: Option<String>,
    /// The turntable; null if there is none.
    turntable: Option<String>,
    /// What the user should know about the result.
    notes: Vec<String>,
    /// Time of each stage; empty if nothing was baked.
    seconds: BTreeMap<String, f64>,
    /// From reading the file to having written the results.
    seconds_total: f64,
}

/// Files beside the combined one.
#[derive(Debug, Default)]
pub(crate) struct Written {
    /// The levels' own files in their order, or none.
    pub(crate) levels: Vec<PathBuf>,
    pub(crate) sheet: Option<PathBuf>,
    pub(crate) turntable: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct Level {
    #[serde(flatten)]
    report: LevelReport,
    /// The level's own file; null if it was not asked for.
    path: Option<String>,
}

#[derive(Serialize)]
struct Document<'a> {
    version: u32,
    /// Why nothing was baked at all; null otherwise.
    error: Option<String>,
    assets: &'a [Outcome],
}

impl Outcome {
    pub(crate) fn done(job: &Job, report: Report, cached: bool, written: Written, elapsed: Duration) -> Self {
        let mut paths = written.levels.into_iter().map(|path| path.display().to_string());
        let levels = report.levels.into_iter().map(|report| Level { report, path: paths.next() }).collect();
        let mut seconds = BTreeMap::new();
        for (stage, time) in report.seconds {
            *seconds.entry(stage).or_default() += time;
        }
        Self {
            input: job.name.clone(),
            output: Some(job.combined_path().display().to_string()),
            status: match report.status {
                Status::Baked if cached => "hit",
                Status::Baked => "baked",
                Status::SmallEnough => "small_enough",
                Status::PassThrough => "pass_through",
                Status::KeptLods => "kept_lods",
            },
            cached,
            error: None,
            levels,
            sheet: written.sheet.map(|path| path.display().to_string()),
            turntable: written.turntable.map(|path| path.display().to_string()),
            notes: report.notes,
            seconds,
            seconds_total: elapsed.as_secs_f64(),
        }
    }

    pub(crate) fn failed(job: &Job, error: String, elapsed: Duration) -> Self {
        Self {
            input: job.name.clone(),
            output: None,
            status: "failed",
            cached: false,
            error: Some(error),
            levels: Vec::new(),
            sheet: None,
            turntable: None,
            notes: Vec::new(),
            seconds: BTreeMap::new(),
            seconds_total: elapsed.as_secs_f64(),
        }
    }

    pub(crate) fn succeeded(&self) -> bool {
        self.error.is_none()
    }

    /// For the console, with notes and what stopped a level below one another.
    pub(crate) fn line(&self) -> String {
        if let Some(error) = &self.error {
            return format!("failed\nerror: {error}");
        }
        let mut text = format!("{} in {}", self.status.replace('_', " "), self.time());
        for note in &self.notes {
            text += &format!("\n  note: {note}");
        }
        for Level { report, .. } in &self.levels {
            if let Some(reason) = &report.stopped {
                text += &format!("\n  note: LOD{} stopped at {} faces: {reason}", report.level, report.faces);
            }
        }
        text
    }

    fn time(&self) -> String {
        format!("{:.2} s", self.seconds_total)
    }

    /// Name, status, faces of `levels` levels, time.
    fn row(&self, levels: usize) -> Vec<String> {
        let faces = |i: usize| self.levels.get(i).map_or("-".to_owned(), |l| l.report.faces.to_string());
        let mut row = vec![self.input.clone(), self.status.replace('_', " ")];
        row.extend((0..levels).map(faces));
        row.push(self.time());
        row
    }
}

/// The closing table; with `json` it goes to stderr, and the document to stdout.
pub(crate) fn print(outcomes: &[Outcome], json: bool) -> Result<(), UsageError> {
    let table = table(outcomes);
    let text = if json {
        console::line(table.trim_end());
        json_text(&Document { version: DOCUMENT_VERSION, error: None, assets: outcomes })?
    } else {
        table
    };
    write_stdout(&text)
}

/// The JSON document of a run that was refused before anything was baked.
pub(crate) fn print_refusal(error: &UsageError) -> Result<(), UsageError> {
    write_stdout(&json_text(&Document { version: DOCUMENT_VERSION, error: Some(error.to_string()), assets: &[] })?)
}

pub(crate) fn json_text(document: &impl Serialize) -> Result<String, UsageError> {
    let text = serde_json::to_string_pretty(document);
    Ok(text.map_err(|e| UsageError(format!("cannot write the JSON document: {e}")))? + "\n")
}

pub(crate) fn write_stdout(text: &str) -> Result<(), UsageError> {
    match io::stdout().write_all(text.as_bytes()) {
        // The reader of a pipe may leave early.
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(UsageError(format!("cannot write to stdout: {e}"))),
        _ => Ok(()),
    }
}

fn table(outcomes: &[Outcome]) -> String {
    let levels = outcomes.iter().map(|o| o.levels.len()).max().unwrap_or(0);
    let mut header = vec!["model".to_owned(), "status".to_owned()];
    header.extend((1..=levels).map(|level| format!("LOD{level}")));
    header.push("time".to_owned());
    let rows: Vec<Vec<String>> = [header].into_iter().chain(outcomes.iter().map(|o| o.row(levels))).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..levels + 3).map(width).collect();
    let mut text = String::new();
    for row in &rows {
        let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, &width))| match column {
            0 | 1 => format!("{cell:<width$}"),
            _ => format!("{cell:>width$}"),
        });
        text += &cells.collect::<Vec<_>>().join("  ");
        text.push('\n');
    }
    let count = |test: &dyn Fn(&Outcome) -> bool| outcomes.iter().filter(|o| test(o)).count();
    let (failed, cached) = (count(&|o| !o.succeeded()), count(&|o| o.cached));
    text + &format!("{} written, {cached} of them from the cache; {failed} failed\n", outcomes.len() - failed)
}
