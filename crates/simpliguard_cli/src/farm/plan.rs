//! `simpliguard farm plan`: finds the models that no tier has, and writes a bundle that bakes them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf, absolute};

use serde::Serialize;
use simpliguard::PIPELINE_VERSION;
use simpliguard_bake::{CachePlace, SHARED_ENV_VAR};
use simpliguard_cache::TierName;

use super::args::PlanArgs;
use super::bundle::{self, Bundle};
use super::chunk::{Chunk, chunks};
use super::cost::Cost;
use super::manifest::{Manifest, Model, State, Task, Worker};
use super::scan::{Scanned, scan};
use crate::Exit;
use crate::console;
use crate::error::UsageError;
use crate::output::{json_text, write_stdout};
use crate::settings_sources::SettingsSources;
use crate::source::read_text;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;
/// Least memory that a worker is asked for, in MiB.
const LEAST_MEMORY: u64 = 4096;

/// The JSON document: numbers of models.
#[derive(Debug, Serialize)]
struct Document {
    version: u32,
    bundle: String,
    /// All models. Each is counted once more below.
    assets: usize,
    /// Models whose results a tier has.
    hits: usize,
    /// Models that the tasks bake.
    misses: usize,
    /// Models whose content and settings are those of a miss.
    duplicates: usize,
    /// Models that cannot be baked.
    failed: Vec<Failure>,
    /// Hits of each tier.
    tiers: BTreeMap<TierName, usize>,
    tasks: usize,
    /// Estimated seconds of all tasks together, on two cores.
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct Failure {
    input: String,
    error: String,
}

/// Carries the command out.
pub(super) fn run(args: &PlanArgs) -> Result<Exit, UsageError> {
    bundle::check(&args.bundle)?;
    let shared = shared_address(args);
    let place = CachePlace { dir: args.cache_dir.as_deref(), shared: shared.as_deref() };
    let (mut scanned, project) = scan(args, place)?;
    scanned.iter_mut().for_each(check_path);
    let manifest = Planner { args, scanned: &scanned }.manifest(project, shared)?;
    write_bundle(&manifest, &scanned, args)?;
    let document = Document::of(&manifest, &args.bundle);
    for Failure { error, .. } in &document.failed {
        console::error(error);
    }
    write_stdout(&if args.json { json_text(&document)? } else { document.text() })?;
    Ok(if document.failed.is_empty() { Exit::Done } else { Exit::SomeFailed })
}

/// The shared cache as the command line or the environment gives it, as an absolute path if it is a folder. That of a project
/// is left to the workers, which read the project themselves.
fn shared_address(args: &PlanArgs) -> Option<String> {
    let variable = || std::env::var(SHARED_ENV_VAR).ok().filter(|address| !address.is_empty());
    let address = args.shared_cache.clone().or_else(variable)?;
    if address.contains("://") { Some(address) } else { Some(absolute(&address).ok()?.to_str()?.to_owned()) }
}

/// A list of models is a text with one path a line. A model whose path cannot stand there fails.
fn check_path(model: &mut Scanned) {
    let found = match model.path.to_str() {
        None => "its path is no UTF-8 text",
        Some(path) if path.contains(['\n', '\r']) => "its path has a line break",
        Some(_) => return,
    };
    model.found = Err(format!("{}: {found}; rename it", model.name));
}

struct Planner<'a> {
    args: &'a PlanArgs,
    scanned: &'a [Scanned],
}

impl Planner<'_> {
    fn manifest(&self, project: Option<PathBuf>, shared_cache: Option<String>) -> Result<Manifest, UsageError> {
        let mut states = self.states();
        let costs: Vec<(usize, Cost)> = self.misses(&states).collect();
        let chunks = chunks(&costs, self.args.task_time.as_secs_f64());
        for (number, chunk) in chunks.iter().enumerate() {
            chunk.models.iter().for_each(|&model| states[model] = State::Task(number + 1));
        }
        let models = self.scanned.iter().zip(states).map(|(scanned, state)| model(scanned, state)).collect();
        let text = |path: &Path| {
            let path = absolute(path).unwrap_or_else(|_| path.to_owned());
            let name = path.display().to_string();
            path.into_os_string().into_string().map_err(|_| UsageError(format!("{name}: the path is no UTF-8 text")))
        };
        Ok(Manifest {
            version: Manifest::version(),
            pipeline_version: PIPELINE_VERSION.to_owned(),
            assets: text(&common_folder(costs.iter().map(|(model, _)| self.scanned[*model].path.as_path())))?,
            project: self.project(project).as_deref().map(text).transpose()?,
            cache_dir: self.args.cache_dir.as_deref().map(text).transpose()?,
            shared_cache,
            has_settings: self.args.settings.settings.is_some(),
            flags: flags(self.args)?,
            worker: self.worker(&costs),
            tasks: chunks.into_iter().map(|Chunk { models, seconds }| Task { models, seconds }).collect(),
            models,
        })
    }

    /// The state of each model. Misses are in task 0 until there are tasks.
    fn states(&self) -> Vec<State> {
        let mut first = BTreeMap::new();
        let state = |(place, model): (usize, &Scanned)| {
            let Ok(found) = &model.found else { return State::Failed };
            match found.tier {
                Some(tier) => State::Hit(tier),
                None => match *first.entry(found.key.hex()).or_insert(place) {
                    other if other == place => State::Task(0),
                    other => State::Duplicate(other),
                },
            }
        };
        self.scanned.iter().enumerate().map(state).collect()
    }

    fn misses(&self, states: &[State]) -> impl Iterator<Item = (usize, Cost)> {
        let missed = states.iter().enumerate().filter(|(_, state)| matches!(state, State::Task(_)));
        missed.filter_map(|(place, _)| Some((place, self.scanned[place].found.as_ref().ok()?.cost)))
    }

    /// The project of the command line, or else the one that all models have.
    fn project(&self, fixed: Option<PathBuf>) -> Option<PathBuf> {
        fixed.or_else(|| {
            let first = self.scanned.first()?.cache.project()?;
            let is_same = |model: &Scanned| model.cache.project() == Some(first);
            self.scanned.iter().all(is_same).then(|| first.to_owned())
        })
    }

    /// The machine that every task can run on. A bake takes at most half of its memory.
    fn worker(&self, costs: &[(usize, Cost)]) -> Worker {
        let most = costs.iter().map(|(_, cost)| cost.memory).max().unwrap_or(0);
        let estimated = (most.saturating_mul(2) >> 20).next_multiple_of(1024).max(LEAST_MEMORY);
        let memory = self.args.worker_memory.map_or(estimated, |size| size.as_u64() >> 20);
        Worker { cpus: self.args.worker_cpus.get(), memory }
    }
}

fn model(scanned: &Scanned, state: State) -> Model {
    Model {
        input: scanned.name.clone(),
        project: scanned.cache.project().map(|project| project.display().to_string()),
        key: scanned.found.as_ref().ok().map(|found| found.key.hex()),
        error: scanned.found.as_ref().err().cloned(),
        state,
    }
}

/// The flags of `bake` that stand for the settings of the command line.
fn flags(args: &PlanArgs) -> Result<Vec<String>, UsageError> {
    let SettingsSources { profile, set, faces, quality, project: _, settings: _ } = &args.settings;
    let timeout = args.timeout.map(|time| humantime::format_duration(time).to_string());
    let single = [("--profile", profile), ("--faces", faces), ("--quality", quality), ("--timeout", &timeout)];
    let single = single.into_iter().filter_map(|(name, value)| Some((name, value.as_ref()?)));
    let flags: Vec<String> =
        single.chain(set.iter().map(|set| ("--set", set))).map(|(name, value)| format!("{name}={value}")).collect();
    // A job template would take it for the name of a parameter.
    match flags.iter().find(|flag| flag.contains("{{")) {
        Some(flag) => Err(UsageError(format!("{flag}: '{{{{' cannot stand in a job; write it to a settings file"))),
        None => Ok(flags),
    }
}

/// The deepest folder that all paths lie in.
fn common_folder<'a>(paths: impl IntoIterator<Item = &'a Path>) -> PathBuf {
    let folder = |path: &'a Path| path.parent().unwrap_or(path).to_owned();
    let common = paths.into_iter().map(folder).reduce(|a, b| {
        let same = a.components().zip(b.components()).take_while(|(a, b)| a == b);
        same.map(|(part, _)| part).collect()
    });
    common.unwrap_or_default()
}

fn write_bundle(manifest: &Manifest, scanned: &[Scanned], args: &PlanArgs) -> Result<(), UsageError> {
    let root = Path::new(&manifest.assets);
    let line = |&place: &usize| {
        let path = &scanned[place].path;
        let below = path.strip_prefix(root).unwrap_or(path).to_string_lossy();
        if cfg!(windows) { below.replace('\\', "/") } else { below.into_owned() }
    };
    let lists: Vec<Vec<String>> = manifest.tasks.iter().map(|task| task.models.iter().map(line).collect()).collect();
    let missed = manifest.tasks.iter().flat_map(|task| &task.models).map(|&place| &scanned[place]);
    let projects = missed.clone().filter_map(|model| Some(model.cache.project()?.join("config/simpliguard.ron")));
    let read = missed.filter_map(|model| model.found.as_ref().ok()).flat_map(|found| found.files.iter().cloned());
    let mut files: Vec<PathBuf> = projects.filter(|file| file.is_file()).chain(read).collect();
    files.sort();
    files.dedup();
    let settings = args.settings.settings.as_deref().map(read_text).transpose();
    let settings = settings.map_err(|e| UsageError(format!("--settings: cannot read the file: {e}")))?;
    Bundle { manifest, lists: &lists, files: &files, settings: settings.as_deref() }.write(&args.bundle)
}

impl Document {
    fn of(manifest: &Manifest, bundle: &Path) -> Self {
        let mut tiers = BTreeMap::from([(TierName::Local, 0), (TierName::Shared, 0)]);
        let (mut misses, mut duplicates, mut failed) = (0, 0, Vec::new());
        for model in &manifest.models {
            match model.state {
                State::Hit(tier) => *tiers.entry(tier).or_default() += 1,
                State::Task(_) => misses += 1,
                State::Duplicate(_) => duplicates += 1,
                State::Failed => {
                    failed.push(Failure { input: model.input.clone(), error: model.error.clone().unwrap_or_default() });
                }
            }
        }
        Self {
            version: DOCUMENT_VERSION,
            bundle: bundle.display().to_string(),
            assets: manifest.models.len(),
            hits: tiers.values().sum(),
            misses,
            duplicates,
            failed,
            tiers,
            tasks: manifest.tasks.len(),
            seconds: manifest.tasks.iter().map(|task| task.seconds).sum(),
        }
    }

    fn text(&self) -> String {
        let Self { bundle, assets, hits, misses, duplicates, failed, tasks, seconds, .. } = self;
        let mut text = format!(
            "{assets} models: {hits} in a cache, {misses} to bake, {duplicates} duplicates of these, {} failed\n",
            failed.len()
        );
        text += &match tasks {
            0 => format!("nothing to bake: {bundle} has no job\n"),
            _ => format!("{tasks} tasks in {bundle}, about {} of work on two cores\n", time(*seconds)),
        };
        text
    }
}

/// A time in words, to the second.
fn time(seconds: f64) -> String {
    let whole = std::time::Duration::try_from_secs_f64(seconds.round().max(1.0));
    whole.map_or("endless".to_owned(), |time| humantime::format_duration(time).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_the_models_holds_them_all() {
        let common = |paths: &[&str]| common_folder(paths.iter().map(Path::new));
        assert_eq!(common(&["/game/assets/a.glb"]), Path::new("/game/assets"));
        assert_eq!(common(&["/game/assets/a.glb", "/game/assets/deep/b.glb"]), Path::new("/game/assets"));
        assert_eq!(common(&["/game/assets/x/a.glb", "/game/assetsb/b.glb"]), Path::new("/game"));
        assert_eq!(common(&[]), Path::new(""));
    }
}
