//! The chain of stages, and the one function that runs it.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::clock::Clock;
use crate::gltf::{self, ExportOptions, Limits};
use crate::level::{Shared, make_level};
use crate::model::{Level, Model};
use crate::refine::Refined;
use crate::render::{Frame, SurfaceSampler, take_views, viewpoints};
use crate::settings::{BakeSettings, Candidates, ExistingLods, Resolution};
use crate::shape::{self, Deviation};
use crate::{Bvh, Context, Error, Source, StageId, reconstruct};

/// Part of every cache key: raised whenever the output of any stage changes for equal input and settings.
pub const PIPELINE_VERSION: &str = "1";

/// A link of the chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Stage {
    /// Its name.
    pub id: StageId,
    /// Raised with its output.
    pub version: u32,
    /// What it does, for the overlay and the report.
    pub purpose: &'static str,
}

/// The processor chain in its order.
pub const STAGES: [Stage; 8] = [
    Stage { id: StageId::Import, version: 1, purpose: "glTF to one surface in world space" },
    Stage { id: StageId::Reconstruct, version: 1, purpose: "watertight manifold around the source" },
    Stage { id: StageId::Shape, version: 1, purpose: "collapse to the budget, unseen faces dropped" },
    Stage { id: StageId::Rig, version: 1, purpose: "joints and weights from the source's skeleton" },
    Stage { id: StageId::Unwrap, version: 1, purpose: "charts, least squares conformal maps, packing" },
    Stage { id: StageId::Texture, version: 1, purpose: "initial texture baked from the source" },
    Stage { id: StageId::Refine, version: 1, purpose: "differentiable rendering of texture and vertices" },
    Stage { id: StageId::Export, version: 1, purpose: "levels and source as one binary glTF" },
];

/// What became of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// It has levels now.
    Baked,
    /// Every budget is at least the source's own face count: it passes through.
    SmallEnough,
    /// It holds no triangles, or its settings switch baking off: it passes through.
    PassThrough,
    /// It came with levels of its own, which are kept.
    KeptLods,
}

/// The outcome of [`bake`].
#[derive(Debug)]
pub struct Baked {
    /// A binary glTF: the source, and the levels behind it.
    pub glb: Vec<u8>,
    /// The levels, budgets ascending; empty unless baked.
    pub levels: Vec<Level>,
    /// The imported source, if it was imported.
    pub model: Option<Model>,
    /// What happened.
    pub report: Report,
}

/// What happened to one file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What became of it.
    pub status: Status,
    /// Triangles of the source's default scene.
    pub source_faces: u64,
    /// One entry per level, budgets ascending.
    pub levels: Vec<LevelReport>,
    /// What was left out or needs attention, in words.
    pub notes: Vec<String>,
    /// Seconds per stage, summed over levels that ran beside each other.
    pub seconds: StageSeconds,
}

/// Seconds by stage name, in the chain's order.
pub type StageSeconds = Vec<(String, f64)>;

/// What happened to one level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelReport {
    /// Counted from 1, the smallest.
    pub level: u32,
    /// Most faces allowed.
    pub budget: u32,
    /// Faces reached.
    pub faces: u32,
    /// Why it has fewer than 98 % of the budget.
    pub stopped: Option<String>,
    /// The road its shape came by.
    pub candidate: String,
    /// Distance to the source that 95 % of both surfaces stay within, as a fraction of the bounding box's diagonal.
    pub error: f32,
    /// Distances in full.
    pub deviation: Deviation,
    /// Charts of the atlas.
    pub charts: u32,
    /// Part of the atlas that charts cover.
    pub fill: f32,
    /// What refinement gained, in dB over held-out views; `None` for a cut-out, which is not refined.
    pub refined: Option<Refined>,
}

/// Bakes levels of detail for one file.
///
/// Equal bytes, settings and [`PIPELINE_VERSION`] give equal results for any number of threads. Work runs on the rayon
/// pool of the caller.
///
/// # Errors
/// See [`Error`]; a source that fails is left as it is.
pub fn bake(source: &Source<'_>, settings: &BakeSettings, context: &Context<'_>) -> Result<Baked, Error> {
    settings.check()?;
    let clock = Clock::default();
    context.report(StageId::Import, None, 0.0);
    if !settings.enabled {
        return Ok(passed_through(source, None, Status::PassThrough, &clock));
    }
    let model = clock.time(StageId::Import, || gltf::import(source, &Limits::default()))?;
    context.check(source.name)?;
    if model.surface.triangles.is_empty() {
        return Ok(passed_through(source, Some(model), Status::PassThrough, &clock));
    }
    if settings.existing_lods == ExistingLods::Keep && gltf::has_levels(&model.document.json) {
        return Ok(passed_through(source, Some(model), Status::KeptLods, &clock));
    }
    let faces = model.surface.triangles.len();
    let budgets: Vec<u32> = settings.faces.iter().copied().filter(|&n| (n as usize) < faces).collect();
    if budgets.is_empty() {
        return Ok(passed_through(source, Some(model), Status::SmallEnough, &clock));
    }
    let (levels, reports) = make_levels(source, &model, &budgets, settings, context, &clock)?;
    context.report(StageId::Export, None, 0.97);
    let options = ExportOptions { source: settings.source, version: PIPELINE_VERSION.to_owned() };
    let glb = clock.time(StageId::Export, || gltf::export(&model, &levels, &options))?;
    context.report(StageId::Export, None, 1.0);
    let report = Report {
        status: Status::Baked,
        source_faces: faces as u64,
        levels: reports,
        notes: model.notes.clone(),
        seconds: clock.seconds(),
    };
    Ok(Baked { glb, levels, model: Some(model), report })
}

/// The source as it is; as binary glTF if it can be.
fn passed_through(source: &Source<'_>, model: Option<Model>, status: Status, clock: &Clock) -> Baked {
    let repacked = model
        .as_ref()
        .filter(|_| !source.bytes.starts_with(b"glTF"))
        .and_then(|model| gltf::export(model, &[], &ExportOptions::default()).ok());
    Baked {
        glb: repacked.unwrap_or_else(|| source.bytes.to_vec()),
        levels: Vec::new(),
        report: Report {
            status,
            source_faces: model.as_ref().map_or(0, |m| m.surface.triangles.len() as u64),
            levels: Vec::new(),
            notes: model.as_ref().map(|m| m.notes.clone()).unwrap_or_default(),
            seconds: clock.seconds(),
        },
        model,
    }
}

fn make_levels(
    source: &Source<'_>,
    model: &Model,
    budgets: &[u32],
    settings: &BakeSettings,
    context: &Context<'_>,
    clock: &Clock,
) -> Result<(Vec<Level>, Vec<LevelReport>), Error> {
    context.report(StageId::Shape, None, 0.05);
    let surface = &model.surface;
    let frame = Frame::around(&surface.positions);
    let hash = blake3::hash(source.bytes);
    let seed = hash.as_bytes()[..8].iter().fold(0u64, |seed, &byte| seed << 8 | u64::from(byte));
    let sampler = SurfaceSampler::new(model);
    let ((bvh, solid), views) = rayon::join(
        || {
            clock
                .time(StageId::Shape, || (Bvh::new(&surface.positions, &surface.triangles), shape::Solid::of(&sampler)))
        },
        || {
            let cameras = viewpoints(&frame, settings.views as usize, seed);
            clock.time(StageId::Refine, || take_views(&sampler, &cameras, settings.view_size as usize))
        },
    );
    context.check(&model.name)?;
    context.report(StageId::Shape, None, 0.15);
    let inputs = shape::Inputs { model, solid: &solid, frame, views: &views };
    let params = shape_params(settings, budgets);
    let shapes = clock.time(StageId::Shape, || shape::shape(&inputs, &params, context))?;
    let deviations: Vec<Deviation> = shapes.par_iter().map(|s| shape::deviation(&inputs, &s.mesh)).collect();
    context.report(StageId::Unwrap, None, 0.4);
    let shared = Shared { model, sampler, bvh, frame, views, seed, settings, context, clock };
    let made: Result<Vec<_>, Error> = shapes
        .par_iter()
        .zip(&deviations)
        .zip(budgets)
        .enumerate()
        .map(|(i, ((shape, deviation), &budget))| make_level(&shared, i as u32 + 1, budget, shape, deviation))
        .collect();
    Ok(made?.into_iter().unzip())
}

fn shape_params(settings: &BakeSettings, budgets: &[u32]) -> shape::Params {
    let thick = |n| reconstruct::Params { offset: 1.5, ..reconstruct::Params::new(n) };
    let reconstructions = match (settings.candidates, settings.resolution) {
        (Candidates::Source, _) => Vec::new(),
        // Fine for large budgets, coarse for small ones, thick where parts lie close together.
        (_, Resolution::Auto) => vec![reconstruct::Params::new(128), reconstruct::Params::new(256), thick(128)],
        (_, Resolution::Cells(n)) => vec![reconstruct::Params::new(n)],
    };
    shape::Params {
        budgets: budgets.to_vec(),
        reconstructions,
        // The source's own triangles need not be closed.
        source: settings.candidates != Candidates::Reconstruction && !settings.watertight,
        cards: settings.candidates == Candidates::All && !settings.watertight,
        remove_invisible: settings.remove_invisible && !settings.watertight,
        visible_weight: f64::from(settings.visible_weight),
        curvature: f64::from(settings.curvature),
    }
}
