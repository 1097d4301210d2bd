//! `simpliguard bench`: how fast this machine bakes, what takes the time, and how much that is beside plain edge collapse
//! by meshoptimizer in the same run. Machines differ, ratios do not.

mod torus;

use std::hint::black_box;
use std::num::{NonZeroU8, NonZeroUsize};
use std::path::Path;
use std::time::Instant;

use meshopt::{SimplifyOptions, VertexDataAdapter};
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;
use simpliguard::data::Surface;
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::refine::Device;
use simpliguard::settings::{BakeSettings, resolve};
use simpliguard::{Context, NoResources, OPT_LEVEL, PIPELINE_VERSION, Printable, Source, bake};
use simpliguard_bake::find_device;
use sysinfo::{CpuRefreshKind, RefreshKind, System};

use crate::args::BenchArgs;
use crate::console;
use crate::error::UsageError;
use crate::output::{columns, json_text, write_stdout};
use crate::project::{ModelSettings, SettingsLookup};
use crate::source::SourceFile;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

#[derive(Debug, Serialize)]
struct Document {
    version: u32,
    pipeline_version: &'static str,
    /// As the pipeline was compiled; below 2, a bake takes many times as long.
    opt_level: &'static str,
    /// Name of the processor.
    processor: String,
    /// The GPU that refines levels. Null for the CPU.
    device: Option<String>,
    model: String,
    /// Triangles of the source.
    faces: usize,
    quality: String,
    runs: Vec<Run>,
}

/// The fastest bake with a number of threads.
#[derive(Debug, Serialize)]
struct Run {
    threads: usize,
    seconds: f64,
    /// Seconds by stage, summed over levels that ran beside each other.
    stages: Vec<(String, f64)>,
    /// Seconds of meshoptimizer for the same numbers of triangles, on one thread.
    meshopt: f64,
    /// Seconds of the bake for one of meshoptimizer.
    ratio: f64,
}

pub(crate) fn run(args: &BenchArgs) -> Result<(), UsageError> {
    let document = match &args.model {
        Some(path) => bench_file(path, args)?,
        None => bench_torus(args)?,
    };
    write_stdout(&if args.json { json_text(&document)? } else { document.text() })
}

fn bench_file(path: &Path, args: &BenchArgs) -> Result<Document, UsageError> {
    let ModelSettings { resolved, cache, .. } = SettingsLookup::new(&args.settings)?.of(path)?;
    let file = SourceFile::read(path, &path.display().to_string(), cache.project())?;
    bench(&file.source(), &resolved?.settings, args)
}

fn bench_torus(args: &BenchArgs) -> Result<Document, UsageError> {
    let resolved = resolve(args.settings.layers()?)?;
    let bytes = torus::torus(args.triangles)?;
    bench(&Source { name: "a bumpy torus", bytes: &bytes, resources: &NoResources }, &resolved.settings, args)
}

/// Bakes without a cache, as often and with as many threads as asked for.
fn bench(source: &Source<'_>, settings: &BakeSettings, args: &BenchArgs) -> Result<Document, UsageError> {
    let surface = import(source, &ImportLimits::default())?.surface;
    let all = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let threads = if args.threads.is_empty() { vec![all] } else { args.threads.iter().map(|n| n.get()).collect() };
    let device = find_device(args.backend.into(), |notice| console::warning(&notice.to_string()));
    let mut runs = Vec::new();
    for threads in threads {
        console::line(&format!("baking {} with {threads} threads", Printable(source.name)));
        runs.push(fastest((source, settings), (&surface, device), threads, args.runs)?);
    }
    Ok(Document {
        version: DOCUMENT_VERSION,
        pipeline_version: PIPELINE_VERSION,
        opt_level: OPT_LEVEL,
        processor: processor(),
        device: device.map(|device| device.name().to_owned()),
        model: source.name.to_owned(),
        faces: surface.triangles.len(),
        quality: format!("{:?}", settings.quality),
        runs,
    })
}

/// Name of this machine's processor; empty if the system does not tell.
fn processor() -> String {
    let system = System::new_with_specifics(RefreshKind::nothing().with_cpu(CpuRefreshKind::nothing()));
    let name = |system: System| system.cpus().first().map(|cpu| cpu.brand().trim().to_owned());
    system.ok().and_then(name).unwrap_or_default()
}

/// The fastest of some bakes.
fn fastest(
    source: (&Source<'_>, &BakeSettings),
    surface: (&Surface, Option<&Device>),
    threads: usize,
    count: NonZeroU8,
) -> Result<Run, UsageError> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| UsageError(format!("--threads {threads}: cannot start them: {e}")))?;
    let mut best = measure(source, surface, &pool)?;
    for _ in 1..count.get() {
        let next = measure(source, surface, &pool)?;
        if next.seconds < best.seconds {
            best = next;
        }
    }
    Ok(best)
}

/// Bakes once, and simplifies to the same numbers of triangles by meshoptimizer.
fn measure(
    (source, settings): (&Source<'_>, &BakeSettings),
    (surface, device): (&Surface, Option<&Device>),
    pool: &ThreadPool,
) -> Result<Run, UsageError> {
    let (start, context) = (Instant::now(), Context { device, ..Context::default() });
    let report = pool.install(|| bake(source, settings, &context))?.report;
    let seconds = start.elapsed().as_secs_f64();
    let budgets: Vec<usize> = report.levels.iter().map(|level| level.budget as usize).collect();
    if budgets.is_empty() {
        return Err(UsageError(format!("{}: no level is baked for it: {}", source.name, report.notes.join("; "))));
    }
    let meshopt = seconds_of_meshopt(surface, &budgets)?;
    let threads = pool.current_num_threads();
    Ok(Run { threads, seconds, stages: report.seconds, meshopt, ratio: seconds / meshopt })
}

/// Seconds of meshoptimizer's edge collapse of the same surface to the same numbers of triangles.
fn seconds_of_meshopt(surface: &Surface, budgets: &[usize]) -> Result<f64, UsageError> {
    let indices = surface.triangles.as_flattened();
    let positions: Vec<u8> = surface.positions.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let vertices = VertexDataAdapter::new(&positions, size_of::<[f32; 3]>(), 0);
    let vertices = vertices.map_err(|e| UsageError(format!("meshoptimizer: {e}")))?;
    let start = Instant::now();
    for budget in budgets {
        black_box(meshopt::simplify(indices, &vertices, 3 * budget, f32::MAX, SimplifyOptions::None, None));
    }
    Ok(start.elapsed().as_secs_f64())
}

impl Run {
    fn seconds_of(&self, stage: &str) -> f64 {
        self.stages.iter().filter(|(name, _)| name == stage).map(|(_, seconds)| seconds).sum()
    }
}

impl Document {
    fn text(&self) -> String {
        let Self { processor, device, opt_level, pipeline_version, model, faces, quality, runs, .. } = self;
        let mut text = format!("{processor}; pipeline version {pipeline_version}, opt-level {opt_level}\n");
        if let Some(device) = device {
            text += &format!("levels refined on {}\n", Printable(device));
        }
        text += &format!("{}: {faces} triangles, quality {quality}\n\n", Printable(model));
        let row = |title: &str, cell: &dyn Fn(&Run) -> String| -> Vec<String> {
            std::iter::once(title.to_owned()).chain(runs.iter().map(cell)).collect()
        };
        let stages = runs[0].stages.iter().map(|(stage, _)| stage.as_str());
        let stage = |stage: &str| row(stage, &|run| format!("{:.2} s", run.seconds_of(stage)));
        let mut rows = vec![row("threads", &|run| run.threads.to_string())];
        rows.extend(stages.map(stage));
        rows.push(row("whole bake", &|run| format!("{:.2} s", run.seconds)));
        rows.push(row("meshoptimizer", &|run| format!("{:.3} s", run.meshopt)));
        rows.push(row("ratio", &|run| format!("{:.0}", run.ratio)));
        text + &columns(&rows, 1, false)
    }
}
