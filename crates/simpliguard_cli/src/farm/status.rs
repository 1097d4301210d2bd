//! `simpliguard farm status`: all models of a plan again. The caches tell what is there, and the reports of the workers why
//! something is not.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use simpliguard_bake::CachePlace;
use simpliguard_cache::{Key, read_bounded};

use super::args::StatusArgs;
use super::manifest::{MOST_BYTES, Manifest, Model, State, report_path};
use super::scan::{Caches, lookup_pool};
use crate::Exit;
use crate::error::UsageError;
use crate::output::{json_text, write_stdout};
use crate::project::ProjectCache;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;
/// Number of models that the text names for each cause.
const SHOWN: usize = 5;

const NO_REPORT: &str = "no worker has reported its task: it has not run yet, or was lost";
const CHANGED: &str = "it was changed after the plan: plan again";
const NOT_SHARED: &str = "it was baked, but no cache that this machine reads has it: look at the shared cache";

/// The JSON document: numbers of models.
#[derive(Debug, Serialize)]
struct Document {
    version: u32,
    bundle: String,
    assets: usize,
    /// Models whose results a cache has.
    done: usize,
    /// Models without a result that no worker has failed on.
    open: usize,
    /// Models that cannot be baked.
    failed: usize,
    /// Numbers of tasks, and of those with a report.
    tasks: usize,
    reported: usize,
    /// Models that workers have baked, and the seconds that they took.
    baked: usize,
    seconds: f64,
    /// Models that are open or failed, by cause, the most frequent first.
    causes: Vec<Cause>,
}

#[derive(Debug, Serialize)]
struct Cause {
    cause: String,
    count: usize,
    inputs: Vec<String>,
}

/// The report of a task, as `bake --report` writes it.
#[derive(Deserialize)]
struct Report {
    pipeline_version: Option<String>,
    error: Option<String>,
    assets: Vec<ReportedModel>,
}

#[derive(Deserialize)]
struct ReportedModel {
    input: String,
    status: String,
    error: Option<String>,
    key: Option<String>,
    seconds_total: f64,
}

/// Carries the command out.
pub(super) fn run(args: &StatusArgs) -> Result<Exit, UsageError> {
    report(&Manifest::read(&args.bundle)?, &args.bundle, args.json)
}

/// Prints the report of a plan.
pub(super) fn report(manifest: &Manifest, bundle: &Path, json: bool) -> Result<Exit, UsageError> {
    let document = Document::of(manifest, bundle)?;
    write_stdout(&if json { json_text(&document)? } else { document.text() })?;
    Ok(if document.done == document.assets { Exit::Done } else { Exit::SomeFailed })
}

impl Document {
    fn of(manifest: &Manifest, bundle: &Path) -> Result<Self, UsageError> {
        let are_done = look_up(manifest)?;
        let reports: Vec<_> = (1..=manifest.tasks.len()).map(|task| read_report(bundle, task)).collect();
        let mut document = Self {
            version: DOCUMENT_VERSION,
            bundle: bundle.display().to_string(),
            assets: manifest.models.len(),
            done: are_done.iter().filter(|is_done| **is_done).count(),
            open: 0,
            failed: 0,
            tasks: manifest.tasks.len(),
            reported: reports.iter().flatten().count(),
            baked: 0,
            seconds: 0.0,
            causes: Vec::new(),
        };
        for model in reports.iter().flatten().flat_map(|report| &report.assets).filter(|m| m.status == "baked") {
            document.baked += 1;
            document.seconds += model.seconds_total;
        }
        let mut causes: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for place in (0..manifest.models.len()).filter(|place| !are_done[*place]) {
            let (is_failure, cause) = cause(manifest, &reports, place);
            *(if is_failure { &mut document.failed } else { &mut document.open }) += 1;
            causes.entry(cause).or_default().push(manifest.models[place].input.clone());
        }
        document.causes =
            causes.into_iter().map(|(cause, inputs)| Cause { cause, count: inputs.len(), inputs }).collect();
        document.causes.sort_by_key(|cause| std::cmp::Reverse(cause.count));
        Ok(document)
    }

    fn text(&self) -> String {
        let Self { assets, done, open, failed, tasks, reported, baked, seconds, .. } = self;
        let mut text = format!("{assets} models: {done} done, {open} open, {failed} failed\n");
        text += &format!("{reported} of {tasks} tasks reported: {baked} models baked in {seconds:.0} s\n");
        for Cause { cause, count, inputs } in &self.causes {
            text += &format!("\n{count} models: {cause}\n");
            text.extend(inputs.iter().take(SHOWN).map(|input| format!("  {input}\n")));
            if inputs.len() > SHOWN {
                text += "  ..\n";
            }
        }
        text
    }
}

/// Tells of each model whether a cache has its result.
fn look_up(manifest: &Manifest) -> Result<Vec<bool>, UsageError> {
    let mut projects = BTreeMap::new();
    for model in &manifest.models {
        if !projects.contains_key(&model.project) {
            let folder = model.project.as_deref().map(Path::new);
            let cache = folder.map_or(Ok(ProjectCache::default()), |folder| ProjectCache::of(Some(folder)))?;
            projects.insert(model.project.clone(), cache);
        }
    }
    let dir = manifest.cache_dir.as_deref().map(Path::new);
    let caches = Caches::open(projects.values(), CachePlace { dir, shared: manifest.shared_cache.as_deref() });
    let is_done = |model: &Model| {
        let key = model.key.as_deref().and_then(Key::from_hex);
        key.is_some_and(|key| caches.locate(&projects[&model.project], &key).is_some())
    };
    Ok(lookup_pool()?.install(|| manifest.models.par_iter().map(is_done).collect()))
}

/// The report of a task. `None` if there is none that can be read: a worker may be writing it.
fn read_report(bundle: &Path, task: usize) -> Option<Report> {
    serde_json::from_slice(&read_bounded(&report_path(bundle, task), MOST_BYTES).ok()?).ok()
}

/// The reason why a model has no result, and whether that is a failure.
fn cause(manifest: &Manifest, reports: &[Option<Report>], place: usize) -> (bool, String) {
    let model = &manifest.models[place];
    let task = match model.state {
        State::Failed => return (true, without_name(model.error.as_deref().unwrap_or_default(), &model.input)),
        State::Duplicate(other) => return cause(manifest, reports, other),
        State::Task(task) => task,
        // It was in a cache when the plan was made.
        State::Hit(_) => return (false, "it was removed from the cache: plan again".to_owned()),
    };
    let Some(Some(report)) = task.checked_sub(1).and_then(|task| reports.get(task)) else {
        return (false, NO_REPORT.to_owned());
    };
    if let Some(error) = &report.error {
        return (true, error.clone());
    }
    // A report has the models in the order of the list.
    let nth = manifest.tasks[task - 1].models.iter().position(|model| *model == place);
    match nth.and_then(|nth| report.assets.get(nth)) {
        Some(ReportedModel { error: Some(error), input, .. }) => (true, without_name(error, input)),
        Some(reported) if reported.key != model.key => (false, other_key(manifest, report)),
        Some(_) => (false, NOT_SHARED.to_owned()),
        None => (false, NO_REPORT.to_owned()),
    }
}

/// The reason why a worker has baked a model under another key than that of the plan.
fn other_key(manifest: &Manifest, report: &Report) -> String {
    let (planned, baked) = (&manifest.pipeline_version, report.pipeline_version.as_ref());
    match baked.filter(|baked| *baked != planned) {
        Some(baked) => format!(
            "a worker with version {baked} of the pipeline has baked it, and the plan is for version {planned}: install one \
             version of simpliguard on all machines, and plan again"
        ),
        None => CHANGED.to_owned(),
    }
}

/// A message without the name of the model it begins with, so that equal causes are equal.
fn without_name(error: &str, name: &str) -> String {
    error.strip_prefix(name).and_then(|rest| rest.strip_prefix(": ")).unwrap_or(error).to_owned()
}
