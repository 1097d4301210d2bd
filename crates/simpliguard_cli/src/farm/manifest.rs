//! The manifest of a bundle, `plan.json`: everything that the other commands need to know of a plan.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use simpliguard_cache::{TierName, read_bounded};

use crate::error::UsageError;

/// Name of the manifest in its bundle.
pub(super) const MANIFEST: &str = "plan.json";
/// Version of the manifest. It is raised when a field changes its meaning or is removed.
const VERSION: u32 = 1;
/// Largest size in bytes of a manifest, and of the report of a task.
pub(super) const MOST_BYTES: u64 = 1 << 30;

/// A plan.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Manifest {
    pub(super) version: u32,
    /// Version of the pipeline that computed the keys.
    pub(super) pipeline_version: String,
    /// Absolute path of the folder that the lists of models are relative to.
    pub(super) assets: String,
    /// The project of all models, if there is one.
    pub(super) project: Option<String>,
    /// The cache's folder, if the plan names one.
    pub(super) cache_dir: Option<String>,
    /// The shared cache, if the plan or the environment names one.
    pub(super) shared_cache: Option<String>,
    /// True if the bundle holds `settings.ron`.
    pub(super) has_settings: bool,
    /// Flags of `bake` with the settings.
    pub(super) flags: Vec<String>,
    pub(super) worker: Worker,
    pub(super) tasks: Vec<Task>,
    pub(super) models: Vec<Model>,
}

/// The machine that a task needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Worker {
    pub(super) cpus: u32,
    /// In MiB.
    pub(super) memory: u64,
}

/// A task: one `simpliguard bake`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Task {
    /// Places of its models in the list of models.
    pub(super) models: Vec<usize>,
    /// Estimated time.
    pub(super) seconds: f64,
}

/// A model of the library.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Model {
    /// The path as the plan was asked for it.
    pub(super) input: String,
    /// The project whose settings of the cache apply to it.
    pub(super) project: Option<String>,
    /// The key of its result; null if it could not be read.
    pub(super) key: Option<String>,
    pub(super) state: State,
    /// The reason why it has no key.
    pub(super) error: Option<String>,
}

/// The state of a model when the plan was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "is", content = "in")]
pub(super) enum State {
    /// A tier had its result.
    Hit(TierName),
    /// The task with this number, from 1, bakes it.
    Task(usize),
    /// The model at this place in the list has the same key.
    Duplicate(usize),
    /// It cannot be baked.
    Failed,
}

impl Manifest {
    pub(super) fn version() -> u32 {
        VERSION
    }

    /// The manifest of a bundle.
    pub(super) fn read(bundle: &Path) -> Result<Self, UsageError> {
        let path = bundle.join(MANIFEST);
        let failed = |found: String| {
            UsageError(format!("{}: {found}; make the bundle with `simpliguard farm plan`", path.display()))
        };
        let json = read_bounded(&path, MOST_BYTES).map_err(|e| failed(format!("cannot read it: {e}")))?;
        let manifest: Self =
            serde_json::from_slice(&json).map_err(|e| failed(format!("it is no plan of this program: {e}")))?;
        if manifest.version != VERSION {
            return Err(failed(format!("it has version {} instead of {VERSION}", manifest.version)));
        }
        manifest.check().map_err(failed)?;
        Ok(manifest)
    }

    /// Checks that tasks have models of the list, and that a duplicate is one of a model that a task bakes.
    fn check(&self) -> Result<(), String> {
        let is_baked = |place: &usize| matches!(self.models.get(*place).map(|m| m.state), Some(State::Task(_)));
        let places = self.tasks.iter().flat_map(|task| &task.models).copied();
        let others = self.models.iter().filter_map(|model| match model.state {
            State::Duplicate(place) => Some(place),
            _ => None,
        });
        match places.chain(others).find(|place| !is_baked(place)) {
            Some(place) => Err(format!("it has no model {place} that a task bakes")),
            None => Ok(()),
        }
    }
}

/// The list of models of a task, numbered from 1.
pub(super) fn list_path(bundle: &Path, task: usize) -> PathBuf {
    bundle.join("tasks").join(format!("{task}.txt"))
}

/// The report of a task.
pub(super) fn report_path(bundle: &Path, task: usize) -> PathBuf {
    bundle.join("reports").join(format!("{task}.json"))
}
