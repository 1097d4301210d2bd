//! The report of a run: one line and one row of a table for each model, or JSON.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Serialize;
use simpliguard::{LevelReport, ObjectReport, PIPELINE_VERSION, Printable, Status};
use simpliguard_bake::Outcome;
use simpliguard_cache::{Counters, Durability, write_atomic};

use crate::Exit;
use crate::console;
use crate::error::UsageError;
use crate::gate::LevelMiss;
use crate::output::{columns, json_text, write_stdout};
use crate::plan::Job;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

/// The report of one model. Serialises to its entry in the JSON document.
#[derive(Debug, Serialize)]
pub(crate) struct JobReport {
    input: String,
    /// The combined file. Null if nothing was written.
    output: Option<String>,
    status: &'static str,
    /// True if the cache had the result.
    cached: bool,
    error: Option<String>,
    levels: Vec<Level>,
    /// The objects of a scene that was baked with `scope: Objects`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    objects: Vec<ObjectReport>,
    /// The bars of the gate that levels miss. Null without `--gate`, and if nothing was written.
    gate: Option<Vec<LevelMiss>>,
    /// The contact sheet. Null if there is none.
    sheet: Option<String>,
    /// The turntable. Null if there is none.
    turntable: Option<String>,
    /// Remarks on the result for the user.
    notes: Vec<String>,
    /// The GPU on which levels were refined. Null for the CPU.
    device: Option<String>,
    /// The key of the result: hexadecimal digits. Null if there is no result.
    key: Option<String>,
    /// Seconds of each stage. Empty if nothing was baked.
    seconds: BTreeMap<String, f64>,
    /// Seconds from reading the file to having written all results.
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
    /// The level's own file. Null if it was not asked for.
    path: Option<String>,
}

#[derive(Serialize)]
struct Document<'a> {
    version: u32,
    pipeline_version: &'static str,
    /// The reason why nothing was baked at all, or null.
    error: Option<String>,
    /// The counts of the tiers of the cache in this run.
    cache: &'a Counters,
    assets: &'a [JobReport],
}

impl<'a> Document<'a> {
    fn new(error: Option<String>, cache: &'a Counters, assets: &'a [JobReport]) -> Self {
        Self { version: DOCUMENT_VERSION, pipeline_version: PIPELINE_VERSION, error, cache, assets }
    }
}

impl JobReport {
    pub(crate) fn done(
        job: &Job,
        outcome: Outcome,
        written: Written,
        gate: Option<Vec<LevelMiss>>,
        elapsed: Duration,
    ) -> Self {
        let (report, cached) = (outcome.result.report, outcome.is_cached);
        let device = report.device().map(str::to_owned);
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
            objects: report.objects,
            gate,
            sheet: written.sheet.map(|path| path.display().to_string()),
            turntable: written.turntable.map(|path| path.display().to_string()),
            notes: report.notes,
            device,
            key: Some(outcome.key.hex()),
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
            objects: Vec::new(),
            gate: None,
            sheet: None,
            turntable: None,
            notes: Vec::new(),
            device: None,
            key: None,
            seconds: BTreeMap::new(),
            seconds_total: elapsed.as_secs_f64(),
        }
    }

    pub(crate) fn succeeded(&self) -> bool {
        self.error.is_none()
    }

    /// The bars of the gate that its levels miss.
    fn missed(&self) -> &[LevelMiss] {
        self.gate.as_deref().unwrap_or_default()
    }

    /// The text for the console: one line, and one more for each note and each level that stopped early.
    pub(crate) fn line(&self) -> String {
        if let Some(error) = &self.error {
            return format!("failed\nerror: {}", Printable(error));
        }
        let mut text = format!("{} in {}", self.status.replace('_', " "), self.time());
        if let Some(device) = &self.device {
            text += &format!("\n  note: refined on {}", Printable(device));
        }
        for miss in self.missed() {
            text += &format!("\nerror: {}", Printable(&miss.line(&self.input)));
        }
        if !self.objects.is_empty() {
            let instances: u32 = self.objects.iter().map(|object| object.instances).sum();
            text += &format!("\n  note: {instances} objects of {} kinds have levels", self.objects.len());
        }
        for note in &self.notes {
            text += &format!("\n  note: {}", Printable(note));
        }
        for Level { report, .. } in &self.levels {
            if let Some(reason) = &report.stopped {
                let reason = Printable(reason);
                text += &format!("\n  note: LOD{} stopped at {} faces: {reason}", report.level, report.faces);
            }
        }
        text
    }

    fn time(&self) -> String {
        format!("{:.2} s", self.seconds_total)
    }

    /// The row of the table: name, status, faces of `levels` levels, time.
    fn row(&self, levels: usize) -> Vec<String> {
        let faces = |i: usize| self.levels.get(i).map_or("-".to_owned(), |l| l.report.faces.to_string());
        let mut row = vec![Printable(&self.input).to_string(), self.status.replace('_', " ")];
        row.extend((0..levels).map(faces));
        row.push(self.time());
        row
    }
}

/// The exit code of a run.
pub(crate) fn exit(reports: &[JobReport]) -> Exit {
    if !reports.iter().all(JobReport::succeeded) {
        Exit::SomeFailed
    } else if reports.iter().any(|report| !report.missed().is_empty()) {
        Exit::GateFailed
    } else {
        Exit::Done
    }
}

/// Prints the table. With `json`, the table goes to stderr and the document to stdout. The document also goes to the file
/// `report`.
pub(crate) fn print(
    reports: &[JobReport],
    cache: &Counters,
    json: bool,
    report: Option<&Path>,
) -> Result<(), UsageError> {
    let table = table(reports);
    let document = json_text(&Document::new(None, cache, reports))?;
    if let Some(path) = report {
        write_atomic(path, document.as_bytes(), Durability::Process)
            .map_err(|e| UsageError(format!("--report: cannot write {}: {e}; all results are kept", path.display())))?;
    }
    if json {
        console::line(table.trim_end());
        write_stdout(&document)
    } else {
        write_stdout(&table)
    }
}

/// Prints the JSON document of a run that was refused before anything was baked.
pub(crate) fn print_refusal(error: &UsageError) -> Result<(), UsageError> {
    let (error, cache) = (Some(error.to_string()), &Counters::default());
    write_stdout(&json_text(&Document::new(error, cache, &[]))?)
}

fn table(reports: &[JobReport]) -> String {
    let levels = reports.iter().map(|report| report.levels.len()).max().unwrap_or(0);
    let mut header = vec!["model".to_owned(), "status".to_owned()];
    header.extend((1..=levels).map(|level| format!("LOD{level}")));
    header.push("time".to_owned());
    let rows: Vec<_> = [header].into_iter().chain(reports.iter().map(|report| report.row(levels))).collect();
    let count = |test: &dyn Fn(&JobReport) -> bool| reports.iter().filter(|report| test(report)).count();
    let (failed, cached) = (count(&|report| !report.succeeded()), count(&|report| report.cached));
    let written = reports.len() - failed;
    let gated = count(&|report| !report.missed().is_empty());
    let gate = if gated == 0 { String::new() } else { format!("; {gated} below the bars of the gate") };
    columns(&rows, 2, false) + &format!("{written} written, {cached} of them from the cache; {failed} failed{gate}\n")
}
