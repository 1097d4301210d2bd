//! The plan: all models to bake and all files to write, checked before the first bake.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use simpliguard::Error;
use simpliguard::settings::{BackendChoice, Resolved};

use crate::args::{BakeArgs, ModelArgs};
use crate::error::UsageError;
use crate::inputs::{self, Input};
use crate::project::{ProjectCache, SettingsLookup};
use crate::source::is_gltf;

/// One model to bake.
#[derive(Debug)]
pub(crate) struct Job {
    /// The file of the model.
    pub(crate) input: PathBuf,
    /// The name of the model in messages.
    pub(crate) name: String,
    /// Its settings. `Err` fails this model alone.
    pub(crate) settings: Result<Resolved, Error>,
    /// The cache as the model's project configures it.
    pub(crate) cache: ProjectCache,
    /// The processor that refines its levels.
    pub(crate) backend: BackendChoice,
    /// The path of the result without extension.
    stem: PathBuf,
}

impl Job {
    /// The file with the source and all levels.
    pub(crate) fn combined_path(&self) -> PathBuf {
        self.with_suffix(".glb")
    }

    /// The file of one level alone.
    pub(crate) fn level_path(&self, budget: u32) -> PathBuf {
        self.with_suffix(&format!("_{budget}.glb"))
    }

    /// The contact sheet.
    pub(crate) fn sheet_path(&self) -> PathBuf {
        self.with_suffix("_sheet.png")
    }

    /// The turntable.
    pub(crate) fn turntable_path(&self) -> PathBuf {
        self.with_suffix("_turntable.png")
    }

    fn with_suffix(&self, suffix: &str) -> PathBuf {
        let mut path = self.stem.clone().into_os_string();
        path.push(suffix);
        path.into()
    }

    /// Every file the job may write.
    fn outputs(&self, args: &BakeArgs) -> Vec<PathBuf> {
        let mut outputs = vec![self.combined_path()];
        // The budgets of other targets are known only when the model is read.
        if let (true, Ok(resolved)) = (args.split_levels, &self.settings)
            && resolved.settings.targets.is_empty()
        {
            outputs.extend(resolved.settings.faces.iter().map(|&budget| self.level_path(budget)));
        }
        if args.sheet {
            outputs.push(self.sheet_path());
        }
        if args.turntable {
            outputs.push(self.turntable_path());
        }
        outputs
    }
}

/// The jobs of a command line, in the order of its inputs.
///
/// # Errors
/// If two jobs would write the same file, or one would overwrite an input.
pub(crate) fn plan(args: &BakeArgs) -> Result<Vec<Job>, UsageError> {
    let jobs = jobs(&args.models, &args.output)?;
    check_outputs(&jobs, args)?;
    Ok(jobs)
}

/// The jobs of models, in the order of the inputs. `output` is the folder of the results.
///
/// # Errors
/// For what is wrong with an input, the project or the settings of the command line.
pub(crate) fn jobs(models: &ModelArgs, output: &Path) -> Result<Vec<Job>, UsageError> {
    let mut lookup = SettingsLookup::new(&models.settings)?;
    let mut jobs = Vec::new();
    let mut inputs = inputs::find(&models.inputs, output, lookup.fixed_project())?;
    if let Some(list) = &models.files_from {
        inputs.extend(inputs::listed(list, models.root.as_deref().unwrap_or(Path::new("")))?);
    }
    for input in without_repetition(inputs) {
        let settings = lookup.of(&input.path)?;
        jobs.push(Job {
            name: input.path.display().to_string(),
            stem: output.join(&input.below),
            input: input.path,
            settings: settings.resolved,
            cache: settings.cache,
            backend: models.backend.unwrap_or(settings.backend),
        });
    }
    Ok(jobs)
}

/// Removes repetitions: a model may be given itself and through its folder.
pub(crate) fn without_repetition(inputs: Vec<Input>) -> Vec<Input> {
    let mut seen = BTreeSet::new();
    let identity = |input: &Input| (same_file(&input.path), input.below.clone());
    inputs.into_iter().filter(|input| seen.insert(identity(input))).collect()
}

fn check_outputs(jobs: &[Job], args: &BakeArgs) -> Result<(), UsageError> {
    let inputs: BTreeMap<PathBuf, &Job> = jobs.iter().map(|job| (same_file(&job.input), job)).collect();
    let mut writers: BTreeMap<PathBuf, &Job> = BTreeMap::new();
    // A file that is no model fails on its own and writes nothing.
    for job in jobs.iter().filter(|job| is_gltf(&job.input)) {
        for output in job.outputs(args) {
            if let Some(input) = inputs.get(&same_file(&output)) {
                let (output, input) = (output.display(), &input.name);
                return Err(UsageError(format!("{output} would overwrite the input {input}; choose another --output")));
            }
            if let Some(other) = writers.insert(same_file(&output), job) {
                let (first, second, output) = (&other.name, &job.name, output.display());
                return Err(UsageError(format!(
                    "{first} and {second} would both be written to {output}; rename one or bake them separately"
                )));
            }
        }
    }
    Ok(())
}

/// A path that is equal for all paths of one file. The file need not exist.
fn same_file(path: &Path) -> PathBuf {
    let absolute = path.canonicalize().or_else(|_| std::path::absolute(path)).unwrap_or_else(|_| path.to_owned());
    if cfg!(any(windows, target_os = "macos")) { absolute.to_string_lossy().to_lowercase().into() } else { absolute }
}
