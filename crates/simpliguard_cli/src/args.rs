//! The command line.

use std::num::{NonZeroU8, NonZeroU16, NonZeroUsize};
use std::path::PathBuf;
use std::time::Duration;

use bytesize::ByteSize;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Parser, Subcommand};
use simpliguard::settings::{BackendChoice, parse_cache_size};

use crate::farm::FarmArgs;
use crate::settings_sources::SettingsSources;

/// Textured, skinned levels of detail for glTF models.
#[derive(Parser, Debug)]
#[command(name = "simpliguard", version, propagate_version = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Subcommand, Debug)]
pub(crate) enum Command {
    Bake(BakeArgs),
    Settings(SettingsArgs),
    Cache(CacheArgs),
    Inspect(InspectArgs),
    Compare(CompareArgs),
    Report(ReportArgs),
    Farm(FarmArgs),
    Bench(BenchArgs),
}

/// Bake levels of detail into models.
///
/// Every model becomes one binary glTF that holds the source and, behind it, its levels. Exit code 0: all baked; 1:
/// some failed, the others are written; 2: wrong usage, nothing was baked; 3: all are written, but a level misses a bar
/// of `--gate`; 130: interrupted.
#[derive(clap::Args, Debug)]
pub(crate) struct BakeArgs {
    #[command(flatten)]
    pub(crate) models: ModelArgs,
    /// Folder of the results. Paths below a searched folder are kept.
    #[arg(long, short, value_name = "DIR", default_value = "lods")]
    pub(crate) output: PathBuf,
    /// Also write each level as a file of its own, `<stem>_<budget>.glb`.
    #[arg(long)]
    pub(crate) split_levels: bool,
    /// Also write a contact sheet, `<stem>_sheet.png`: the source beside its levels.
    #[arg(long)]
    pub(crate) sheet: bool,
    /// Also write a turntable, `<stem>_turntable.png`: an animated PNG of the source and its levels.
    #[arg(long)]
    pub(crate) turntable: bool,
    #[command(flatten)]
    pub(crate) gate: GateArgs,
    /// Print one JSON document to stdout; everything else goes to stderr.
    #[arg(long)]
    pub(crate) json: bool,
    /// Also write the JSON document to a file.
    #[arg(long, value_name = "FILE")]
    pub(crate) report: Option<PathBuf>,
}

/// Models, their settings, and what their bakes may take.
#[derive(clap::Args, Debug)]
pub(crate) struct ModelArgs {
    /// .glb and .gltf files, folders, or patterns such as `models/*.glb`. Folders are searched for both, except hidden folders and the folder of the results.
    #[arg(required_unless_present = "files_from", value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
    /// A text file with more inputs: the path of one model a line. Their paths are kept below the output folder.
    #[arg(long, value_name = "FILE")]
    pub(crate) files_from: Option<PathBuf>,
    /// Folder that the paths in `--files-from` are relative to; else the current folder.
    #[arg(long, value_name = "DIR", requires = "files_from")]
    pub(crate) root: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: SettingsSources,
    /// Number of threads; all cores if not given. The results are the same for any number.
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<NonZeroUsize>,
    /// Memory that the bake of one model may take, such as `4GiB`; half of the machine's if not given. A model that would
    /// take more is refused before anything is allocated for it.
    #[arg(long, value_name = "SIZE")]
    pub(crate) memory: Option<ByteSize>,
    /// Longest time for one model, such as `90s` or `10m`. A model that takes longer fails, and the next one is baked.
    #[arg(long, value_name = "DURATION", value_parser = humantime::parse_duration)]
    pub(crate) timeout: Option<Duration>,
    /// The processor that refines levels: `auto` takes a GPU if there is one; else `backend` of the project, else `cpu`. The
    /// results of another processor differ by rounding.
    #[arg(long, value_name = "BACKEND", value_parser = backend_parser())]
    pub(crate) backend: Option<BackendChoice>,
    /// Bake each model in a process of its own, so that a crash or a lack of memory costs that model alone.
    #[arg(long)]
    pub(crate) isolate: bool,
    /// The cache's folder; else $SIMPLIGUARD_CACHE_DIR, else `cache.dir` of the project, else the user's cache folder.
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    pub(crate) cache_dir: Option<PathBuf>,
    /// A folder or an address such as `s3://bucket/folder` where machines share results; else
    /// $SIMPLIGUARD_SHARED_CACHE, else `cache.shared` of the project.
    #[arg(long, value_name = "URL", conflicts_with = "no_cache")]
    pub(crate) shared_cache: Option<String>,
    /// Bake without a cache.
    #[arg(long)]
    pub(crate) no_cache: bool,
}

/// Write a report: one HTML page of models, their levels, and what the bakes cost and kept.
///
/// The page needs no network and no other file. Models that the cache has no result of are baked. Exit code 0: written;
/// 1: written, but some models failed; 2: wrong usage, or the page cannot be written; 130: interrupted.
#[derive(clap::Args, Debug)]
pub(crate) struct ReportArgs {
    #[command(flatten)]
    pub(crate) models: ModelArgs,
    /// The page.
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    pub(crate) out: PathBuf,
    /// Number of views for the figures, evenly spread around each source.
    #[arg(long, value_name = "N", default_value = "20")]
    pub(crate) views: NonZeroU16,
    /// Weights of SqueezeNet and LPIPS as safetensors, for LPIPS and NLPIPS. docs/command.md has the command that makes the
    /// file. It takes about a second for each view and level.
    #[arg(long, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,
    /// Size that the page should not exceed. The models in it have fewer triangles and smaller textures for that; pictures and
    /// figures are those of the full models.
    #[arg(long, value_name = "SIZE", default_value = "40MB")]
    pub(crate) max_size: ByteSize,
}

/// Bars that every level must meet.
#[derive(clap::Args, Clone, Debug, Default, PartialEq)]
pub(crate) struct GateArgs {
    /// Check every level, also of results from the cache: exit code 3 if one misses a bar. It must meet
    /// `warn_below` and the bars of the model's settings, and those below. The files are written all the same.
    #[arg(long)]
    pub(crate) gate: bool,
    /// Least `likeness.psnr` of the report, in dB.
    #[arg(long, value_name = "DB", requires = "gate")]
    pub(crate) min_psnr: Option<f32>,
    /// Least `likeness.silhouette_iou` of the report, 0 to 1.
    #[arg(long, value_name = "FRACTION", requires = "gate")]
    pub(crate) min_silhouette_iou: Option<f32>,
    /// Largest `deviation.percentile_95` of the report, as a fraction of the diagonal of the bounding box.
    #[arg(long, value_name = "FRACTION", requires = "gate")]
    pub(crate) max_deviation: Option<f32>,
}

/// Inspect and clean the cache.
///
/// Exit code 0: done; 1: something is damaged or could not be done; 2: wrong usage.
#[derive(clap::Args, Debug)]
pub(crate) struct CacheArgs {
    #[command(subcommand)]
    pub(crate) command: CacheCommand,
    /// The cache's folder; else $SIMPLIGUARD_CACHE_DIR, else `cache.dir` of the project, else the user's cache folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub(crate) cache_dir: Option<PathBuf>,
    /// The project with the cache; else the nearest project above the current folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub(crate) project: Option<PathBuf>,
    /// Print one JSON document to stdout.
    #[arg(long, global = true)]
    pub(crate) json: bool,
}

#[derive(Subcommand, Clone, Debug)]
pub(crate) enum CacheCommand {
    /// Print the content of the cache, and the hits and misses of each tier.
    Stats,
    /// Remove files that nobody can use; if the cache is too large, also the least recently used files.
    Gc {
        /// Largest size of the cache, such as `5GiB`; else `cache.max_size` of the project, else 10 GiB.
        #[arg(long, value_name = "SIZE", value_parser = parse_cache_size)]
        max_size: Option<u64>,
    },
    /// Read and hash all files, and move damaged files to quarantine.
    Verify {
        /// Also bake a sample of ASSETs again, such as `1%` of those in the cache, and compare the results byte by byte.
        #[arg(long, value_name = "PERCENT", value_parser = parse_percent, requires = "assets")]
        rebake: Option<f64>,
        /// Models as for `bake`. They are looked up with the settings of their projects.
        #[arg(value_name = "ASSET", requires = "rebake")]
        assets: Vec<PathBuf>,
    },
    /// Write a new secret key to a file, and print its public key. Machines with $SIMPLIGUARD_SIGNING_KEY sign what they store
    /// in the shared cache; those with $SIMPLIGUARD_TRUSTED_KEYS use only what a trusted key has signed.
    Keygen {
        /// A new file for the secret key.
        file: PathBuf,
    },
    /// Remove all files of the cache.
    Clear,
}

/// Print the settings reference, or the settings of a model.
///
/// Without a subcommand: every field as RON, with its documentation, range and built-in value.
#[derive(clap::Args, Debug)]
pub(crate) struct SettingsArgs {
    #[command(subcommand)]
    pub(crate) command: Option<SettingsCommand>,
}

#[derive(Subcommand, Debug)]
pub(crate) enum SettingsCommand {
    /// Print the settings that a model is baked with, and the origin of each value.
    Show {
        /// The model. It is not read, and need not exist.
        asset: PathBuf,
        #[command(flatten)]
        settings: SettingsSources,
    },
}

/// Print what is in a model, the settings it is baked with, and whether the cache has its levels; or how this version
/// bakes.
#[derive(clap::Args, Debug)]
pub(crate) struct InspectArgs {
    /// A .glb or .gltf file: a source, or an output of `bake`.
    #[arg(required_unless_present = "pipeline", conflicts_with = "pipeline")]
    pub(crate) file: Option<PathBuf>,
    /// Print the stages of the pipeline in their order: version, weight in the progress, and purpose.
    #[arg(long)]
    pub(crate) pipeline: bool,
    #[command(flatten)]
    pub(crate) settings: SettingsSources,
    /// The cache's folder; else $SIMPLIGUARD_CACHE_DIR, else `cache.dir` of the project, else the user's cache folder.
    #[arg(long, value_name = "DIR")]
    pub(crate) cache_dir: Option<PathBuf>,
    /// Print one JSON document to stdout.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Compare levels with their source: how much they look like it, and how far they are from it.
///
/// Exit code 0: compared; 2: wrong usage, or a file that cannot be read.
#[derive(clap::Args, Debug)]
pub(crate) struct CompareArgs {
    /// The source: a .glb or .gltf file.
    pub(crate) source: PathBuf,
    /// Files of levels, such as `lods/model_1000.glb`. Of an output with several levels, each is compared. Without any, the
    /// source is an output itself, and its own levels are compared.
    #[arg(value_name = "LEVEL")]
    pub(crate) levels: Vec<PathBuf>,
    /// Number of views, evenly spread around the source.
    #[arg(long, value_name = "N", default_value = "80")]
    pub(crate) views: NonZeroU16,
    /// Also compare frames of the clips that both have.
    #[arg(long)]
    pub(crate) motion: bool,
    /// Weights of SqueezeNet and LPIPS as safetensors, for LPIPS and NLPIPS. docs/command.md has the command that makes the
    /// file. It takes about a second for each view and level.
    #[arg(long, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,
    /// Kinds of objects of a scene to compare at most, each alone: those with the most triangles. 0 for none.
    #[arg(long, value_name = "N", default_value = "8")]
    pub(crate) objects: usize,
    /// Print one JSON document to stdout.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Measure how fast this machine bakes: seconds of each stage, beside plain edge collapse by meshoptimizer in the same run.
///
/// No cache is asked. Exit code 0: measured; 2: wrong usage, or a model that cannot be baked.
#[derive(clap::Args, Debug)]
pub(crate) struct BenchArgs {
    /// A .glb or .gltf file; a generated shape if not given.
    pub(crate) model: Option<PathBuf>,
    /// Triangles of the generated shape, at most five million.
    #[arg(long, value_name = "N", default_value = "100000", value_parser = clap::value_parser!(u32).range(18..=5_000_000), conflicts_with = "model")]
    pub(crate) triangles: u32,
    #[command(flatten)]
    pub(crate) settings: SettingsSources,
    /// Numbers of threads to measure, such as `1,2,4`; all cores if not given.
    #[arg(long, value_name = "N,N,..", value_delimiter = ',')]
    pub(crate) threads: Vec<NonZeroUsize>,
    /// The processor that refines levels.
    #[arg(long, value_name = "BACKEND", default_value = "cpu", value_parser = backend_parser())]
    pub(crate) backend: BackendChoice,
    /// Bakes with each number of threads. The fastest counts.
    #[arg(long, value_name = "N", default_value = "1")]
    pub(crate) runs: NonZeroU8,
    /// Print one JSON document to stdout.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Reads a backend by its name.
fn backend_parser() -> impl TypedValueParser<Value = BackendChoice> {
    PossibleValuesParser::new(["auto", "cpu", "gpu"]).map(|name| match name.as_str() {
        "cpu" => BackendChoice::Cpu,
        "gpu" => BackendChoice::Gpu,
        _ => BackendChoice::Auto,
    })
}

/// A fraction from a text such as `1%`.
fn parse_percent(text: &str) -> Result<f64, String> {
    let percent = text.strip_suffix('%').and_then(|number| number.trim().parse::<f64>().ok());
    let valid = percent.filter(|percent| *percent > 0.0 && *percent <= 100.0);
    valid.map(|percent| percent / 100.0).ok_or_else(|| "expected a percentage above 0% and up to 100%".to_owned())
}
