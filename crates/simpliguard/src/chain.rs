//! The chain of stages, and the one function that runs it.

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::clock::Clock;
use crate::gltf::{self, ExportOptions, Limits};
use crate::mesh::TriMesh;
use crate::model::{AlphaMode, Influences, Level, Model, linear_to_srgb};
use crate::refine::{self, LowPoly, Refined};
use crate::render::{Frame, SurfaceSampler, View, take_views, viewpoints};
use crate::rig::{self, Transfer};
use crate::settings::{BakeSettings, Candidates, ExistingLods, Resolution, SkinTransfer};
use crate::shape::{self, Deviation, Road, Shape};
use crate::texture::{self, Channels};
use crate::unwrap::{UnwrapParams, unwrap};
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
    /// What refinement gained, in dB over held-out views.
    pub refined: Refined,
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

/// What all levels share.
struct Shared<'a> {
    model: &'a Model,
    sampler: SurfaceSampler<'a>,
    bvh: Bvh,
    frame: Frame,
    views: Vec<View>,
    seed: u64,
    settings: &'a BakeSettings,
    context: &'a Context<'a>,
    clock: &'a Clock,
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
    let (bvh, views) = rayon::join(
        || clock.time(StageId::Shape, || Bvh::new(&surface.positions, &surface.triangles)),
        || {
            let cameras = viewpoints(&frame, settings.views as usize, seed);
            clock.time(StageId::Refine, || take_views(&sampler, &cameras, settings.view_size as usize))
        },
    );
    context.check(&model.name)?;
    context.report(StageId::Shape, None, 0.15);
    let inputs = shape::Inputs { model, bvh: &bvh, frame, views: &views };
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
    let resolutions = match settings.resolution {
        Resolution::Auto => vec![128, 256],
        Resolution::Cells(n) => vec![n],
    };
    let reconstructions = match settings.candidates {
        Candidates::Source => Vec::new(),
        _ => resolutions.into_iter().map(reconstruct::Params::new).collect(),
    };
    shape::Params {
        budgets: budgets.to_vec(),
        reconstructions,
        // The source's own triangles need not be closed.
        source: settings.candidates != Candidates::Reconstruction && !settings.watertight,
        remove_invisible: settings.remove_invisible && !settings.watertight,
        visible_weight: f64::from(settings.visible_weight),
        curvature: f64::from(settings.curvature),
    }
}

/// Rig, unwrap, texture and refine for one shape.
fn make_level(
    shared: &Shared<'_>,
    number: u32,
    budget: u32,
    shape: &Shape,
    deviation: &Deviation,
) -> Result<(Level, LevelReport), Error> {
    let Shared { model, settings, context, clock, .. } = *shared;
    context.check(&model.name)?;
    let size = texture_size(settings, budget) as usize;
    let params = UnwrapParams { size: size as u32, gutter: settings.gutter };
    context.report(StageId::Unwrap, Some(number as usize), 0.4);
    let atlas = clock.time(StageId::Unwrap, || unwrap(&shape.mesh, None, &params));
    let texels = texture::texel_map(&atlas, size);

    context.report(StageId::Texture, Some(number as usize), 0.45);
    let bake = |mesh: &TriMesh| texture::bake(&shared.sampler, &shared.bvh, &shared.frame, mesh, &atlas, &texels, size);
    let alpha = wants_alpha(model, shape);
    let (initial, covered) = clock.time(StageId::Texture, || initial_texture(&bake(&shape.mesh), size));
    let mut low = LowPoly::new(&shape.mesh, &atlas, shape.double_sided || alpha, size, initial, covered);

    context.report(StageId::Refine, Some(number as usize), 0.5);
    let refined = clock.time(StageId::Refine, || {
        let params = refine::Params {
            // A cut-out's outline is in its texture, not at its vertices.
            steps: if alpha { 0 } else { settings.refine_steps },
            step_length: settings.step_length,
            smoothness: settings.texture_smoothness,
            resolve_every: 40,
            seed: shared.seed ^ u64::from(budget),
        };
        refine::refine(&mut low, &shared.views, shared.frame.radius, &params, &model.name, context)
    })?;

    let mesh = low.mesh();
    context.report(StageId::Rig, Some(number as usize), 0.9);
    let influences = clock.time(StageId::Rig, || influences(shared, &mesh));
    let unlit = model.materials.iter().all(|m| m.unlit);
    let channels = Channels { normal: settings.normal_map && !unlit, alpha };
    let (mesh, textures, material) = clock.time(StageId::Texture, || {
        let samples = bake(&mesh);
        let mesh = texture::level_mesh(&mesh, &atlas, &influences, channels.normal);
        let (textures, varying) = texture::maps(&mesh, &texels, &samples, &low.texels, size, channels);
        (mesh, textures, texture::level_material(&varying, alpha, low.double_sided, unlit))
    });
    let faces = mesh.triangles.len() as u32;
    let report = LevelReport {
        level: number,
        budget,
        faces,
        stopped: (f64::from(faces) < 0.98 * f64::from(budget))
            .then(|| "no further face can be spent: collapses that small parts need remove several at once".to_owned()),
        candidate: shape.road.to_string(),
        error: deviation.percentile_95,
        deviation: *deviation,
        charts: atlas.charts as u32,
        fill: atlas.fill,
        refined,
    };
    Ok((Level { budget, error: deviation.percentile_95, mesh, material, textures }, report))
}

fn influences(shared: &Shared<'_>, mesh: &TriMesh) -> Vec<Influences> {
    let method = match shared.settings.skin_transfer {
        SkinTransfer::ClosestSurface => Transfer::default(),
        SkinTransfer::NearestVertices => Transfer::NearestVertices { k: 4 },
    };
    rig::transfer(shared.model, &shared.bvh, mesh, &mesh.vertex_normals(), method).0
}

/// Levels of at most 1,000 faces are seen from afar: half the texture is enough.
fn texture_size(settings: &BakeSettings, budget: u32) -> u32 {
    if budget <= 1000 { (settings.texture_size / 2).max(64) } else { settings.texture_size }
}

/// Whether the level is a cut-out: it consists of the source's own triangles and most of their area is masked or blended.
fn wants_alpha(model: &Model, shape: &Shape) -> bool {
    if shape.road != Road::Source {
        return false;
    }
    let (mut cut, mut all) = (0.0, 0.0);
    for (triangle, &material) in model.surface.triangles.iter().zip(&model.surface.material) {
        let [a, b, c] = triangle.map(|v| model.surface.positions[v as usize]);
        let area = f64::from((b - a).cross(c - a).length());
        all += area;
        cut += if model.materials[material as usize].alpha_mode == AlphaMode::Opaque { 0.0 } else { area };
    }
    2.0 * cut > all
}

/// Encoded colours with their gutters, and which texels a triangle covers.
fn initial_texture(samples: &[Option<crate::render::SurfaceSample>], size: usize) -> (Vec<Vec4>, Vec<bool>) {
    let covered: Vec<bool> = samples.iter().map(Option::is_some).collect();
    let encoded = |s: &crate::render::SurfaceSample| {
        let c = s.base_color;
        Vec3::new(linear_to_srgb(c.x), linear_to_srgb(c.y), linear_to_srgb(c.z)).extend(1.0)
    };
    let grey = Vec4::new(0.5, 0.5, 0.5, 1.0);
    let mut texels: Vec<Vec4> =
        samples.par_iter().with_min_len(4096).map(|s| s.as_ref().map_or(grey, encoded)).collect();
    texture::dilate(&mut texels, &mut covered.clone(), size, texture::GUTTER_STEPS);
    (texels, covered)
}
