//! `simpliguard inspect`: the contents of a model, its settings and its result in the cache; or the stages of the pipeline.

mod contents;
pub(crate) mod document;
mod pipeline;
mod result;
mod stages;
mod table;

use std::path::Path;

use serde::Serialize;
use simpliguard::PIPELINE_VERSION;
use simpliguard::gltf::{GpuCost, ImportLimits, gpu_cost, gpu_cost_besides, import};
use simpliguard_bake::{CachePlace, CachedBake, Parts};

use self::contents::Contents;
use self::document::Document;
use self::result::CachedResult;
use self::stages::StageResult;
use crate::args::InspectArgs;
use crate::console;
use crate::error::UsageError;
use crate::levels::{Kind, Level, Levels};
use crate::output::{json_text, write_stdout};
use crate::project::{ModelSettings, SettingsLookup};
use crate::source::SourceFile;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

/// Everything that is said about a model.
#[derive(Serialize)]
struct Inspection {
    version: u32,
    pipeline_version: &'static str,
    file: String,
    /// Size of the file, without those that it refers to.
    bytes: u64,
    contents: Contents,
    /// The source: all meshes of the default scene that are no levels.
    source: GpuCost,
    /// The levels in an output of `bake`.
    levels: Vec<LevelSize>,
    /// All levels together, besides the source.
    all_levels: GpuCost,
    /// The kinds of objects in an output of `bake` with `scope: Objects`.
    objects: Vec<ObjectSize>,
    settings: Vec<Setting>,
    /// The stages of the bake and their results; none for a file that gets no levels.
    stages: Vec<StageResult>,
    result: CachedResult,
    /// Notes on what the import leaves out.
    notes: Vec<String>,
}

/// A level in an output of `bake`, and what it takes up.
#[derive(Serialize)]
struct LevelSize {
    name: String,
    level: u64,
    budget: Option<u64>,
    faces: Option<u64>,
    error: Option<f64>,
    /// Bytes of its vertices, indices and images in the file.
    bytes: u64,
    /// Its cost besides the source, whose textures it may show.
    #[serde(flatten)]
    gpu: GpuCost,
}

/// Objects that share their levels.
#[derive(Serialize)]
struct ObjectSize {
    name: String,
    instances: usize,
    /// Triangles of one instance. Null if the file has dropped them.
    triangles: Option<u64>,
    levels: Vec<ObjectLevel>,
}

#[derive(Serialize)]
struct ObjectLevel {
    level: u64,
    budget: Option<u64>,
    faces: Option<u64>,
    error: Option<f64>,
}

impl ObjectSize {
    fn of(kind: Kind) -> Self {
        let level = |Level { level, budget, faces, error, .. }: Level| ObjectLevel { level, budget, faces, error };
        let Kind { name, instances, triangles, levels, .. } = kind;
        Self { name, instances, triangles, levels: levels.into_iter().map(level).collect() }
    }
}

/// A setting that the model is baked with.
#[derive(Serialize)]
struct Setting {
    name: &'static str,
    value: String,
    origin: String,
}

pub(crate) fn run(args: &InspectArgs) -> Result<(), UsageError> {
    let text = match &args.file {
        Some(file) => {
            let inspection = inspect(file, args)?;
            if args.json { json_text(&inspection)? } else { table::text(&inspection) }
        }
        None => pipeline::text(args.json)?,
    };
    write_stdout(&text)
}

fn inspect(path: &Path, args: &InspectArgs) -> Result<Inspection, UsageError> {
    let name = path.display().to_string();
    let ModelSettings { resolved, cache, .. } = SettingsLookup::new(&args.settings)?.of(path)?;
    let resolved = resolved?;
    let file = SourceFile::read(path, &name, cache.project())?;
    let model = import(&file.source(), &ImportLimits::default())?;
    let document = Document::new(&model);
    let Levels { all, kinds, .. } = Levels::of(&model.document.json);
    let source = || model.document.mesh_nodes.iter().copied();
    let of_levels = |nodes: Vec<usize>| gpu_cost_besides(&model.document, nodes, source());
    let all_levels = of_levels(all.iter().flat_map(|level| level.nodes.iter().copied()).collect());
    let size = |level: Level| {
        let (bytes, gpu) = (document.bytes_of_nodes(&level.nodes), of_levels(level.nodes));
        let Level { name, level, budget, faces, error, .. } = level;
        LevelSize { name, level, budget, faces, error, bytes, gpu }
    };
    let explicit = CachePlace { dir: args.cache_dir.as_deref(), shared: None };
    let cache = cache.open(explicit, |outside| console::warning(&outside.to_string()));
    let bake = CachedBake::new(file.source(), &resolved.settings, Parts::Combined, cache.as_ref())?;
    let result = CachedResult::find(&bake, cache.as_ref());
    Ok(Inspection {
        version: DOCUMENT_VERSION,
        pipeline_version: PIPELINE_VERSION,
        bytes: file.source().bytes.len() as u64,
        contents: Contents::of(&model, &document),
        source: gpu_cost(&model.document, source()),
        levels: all.into_iter().map(size).collect(),
        all_levels,
        objects: kinds.into_iter().map(ObjectSize::of).collect(),
        settings: resolved
            .effective()
            .map(|e| Setting { name: e.name, value: e.value, origin: e.origin.to_string() })
            .collect(),
        stages: stages::results(&file.source(), &resolved.settings, cache.as_ref(), &result),
        result,
        notes: model.notes.clone(),
        file: name,
    })
}
