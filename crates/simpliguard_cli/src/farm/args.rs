//! The arguments of `simpliguard farm`.

use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;
use std::time::Duration;

use bytesize::ByteSize;
use clap::Subcommand;

use crate::settings_sources::SettingsSources;

/// Bake a library of models on many machines.
///
/// Exit code 0: done; 1: a model failed or is not baked; 2: wrong usage.
#[derive(clap::Args, Debug)]
pub(crate) struct FarmArgs {
    #[command(subcommand)]
    pub(super) command: FarmCommand,
}

#[derive(Subcommand, Debug)]
pub(super) enum FarmCommand {
    Plan(Box<PlanArgs>),
    Run(RunArgs),
    Submit(SubmitArgs),
    Status(StatusArgs),
}

/// Find the models that no cache has, and write a bundle of tasks that bakes them.
///
/// The bundle is a job of Open Job Description: `template.yaml`, `parameter_values.yaml`, `asset_references.yaml`, and a
/// list of models for each task. Nothing is baked.
#[derive(clap::Args, Debug)]
pub(super) struct PlanArgs {
    /// .glb and .gltf files, folders, or patterns, as for `bake`.
    #[arg(required = true, value_name = "ASSET")]
    pub(super) assets: Vec<PathBuf>,
    /// Folder of the bundle: a new or empty one, or that of a former plan, which is replaced.
    #[arg(long, value_name = "DIR")]
    pub(super) bundle: PathBuf,
    #[command(flatten)]
    pub(super) settings: SettingsSources,
    /// The cache's folder, here and on the workers; else each machine's own, as for `bake`.
    #[arg(long, value_name = "DIR")]
    pub(super) cache_dir: Option<PathBuf>,
    /// A folder or an address such as `s3://bucket/folder` where machines share results; else
    /// $SIMPLIGUARD_SHARED_CACHE, else `cache.shared` of the project.
    #[arg(long, value_name = "URL")]
    pub(super) shared_cache: Option<String>,
    /// Estimated time of a task. A model that takes longer has a task of its own.
    #[arg(long, value_name = "DURATION", default_value = "10m", value_parser = humantime::parse_duration)]
    pub(super) task_time: Duration,
    /// Cores that a worker must have.
    #[arg(long, value_name = "N", default_value = "2")]
    pub(super) worker_cpus: NonZeroU32,
    /// Memory that a worker must have, such as `16GiB`; else estimated from the largest model. One bake takes at most half.
    #[arg(long, value_name = "SIZE")]
    pub(super) worker_memory: Option<ByteSize>,
    /// Longest time for one model on a worker, such as `10m`.
    #[arg(long, value_name = "DURATION", value_parser = humantime::parse_duration)]
    pub(super) timeout: Option<Duration>,
    /// Print one JSON document to stdout.
    #[arg(long)]
    pub(super) json: bool,
}

/// Run the tasks of a bundle, each by `openjd run` (PyPI: `openjd-cli`), and print the report.
#[derive(clap::Args, Debug)]
pub(super) struct RunArgs {
    /// Folder of the bundle.
    #[arg(long, value_name = "DIR")]
    pub(super) bundle: PathBuf,
    /// Run on this machine.
    #[arg(long, required = true)]
    pub(super) local: bool,
    /// Number of tasks at a time.
    #[arg(long, value_name = "N", default_value = "1")]
    pub(super) jobs: NonZeroUsize,
    /// The program `openjd`.
    #[arg(long, value_name = "PROGRAM", default_value = "openjd")]
    pub(super) openjd: PathBuf,
    /// Print the report as one JSON document to stdout.
    #[arg(long)]
    pub(super) json: bool,
}

/// Submit the tasks of a bundle to a scheduler.
#[derive(clap::Args, Debug)]
pub(super) struct SubmitArgs {
    /// Folder of the bundle, on a file system that the workers have under the same path.
    #[arg(long, value_name = "DIR")]
    pub(super) bundle: PathBuf,
    /// Submit to Slurm, as job arrays. The script is `slurm.sh` of the bundle.
    #[arg(long, required = true)]
    pub(super) slurm: bool,
    /// Write the script, print the commands, and submit nothing.
    #[arg(long)]
    pub(super) dry_run: bool,
    /// Path of the command on the workers; that of this program if not given.
    #[arg(long, value_name = "PROGRAM")]
    pub(super) command: Option<PathBuf>,
    /// Most tasks of one array. Slurm's own limit is `MaxArraySize` - 1, by default 1000.
    #[arg(long, value_name = "N", default_value = "1000")]
    pub(super) array_size: NonZeroUsize,
    /// More arguments for `sbatch`, such as `-- --partition=farm`.
    #[arg(last = true, value_name = "SBATCH")]
    pub(super) sbatch: Vec<String>,
}

/// Look all models of a plan up again, and print what is there, what is missing, and why.
#[derive(clap::Args, Debug)]
pub(super) struct StatusArgs {
    /// Folder of the bundle.
    #[arg(long, value_name = "DIR")]
    pub(super) bundle: PathBuf,
    /// Print one JSON document to stdout.
    #[arg(long)]
    pub(super) json: bool,
}
