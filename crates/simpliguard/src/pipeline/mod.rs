//! The pipeline: the order of the stages, and the one function that runs them.

mod clock;
pub(crate) mod context;
mod level;
pub(crate) mod store;
mod targets;

use serde::{Deserialize, Serialize};

use crate::animation::Poses;
use crate::data::{Deviation, Level, Model, SMALLEST_EXTENT, TriMesh};
use crate::geometry::{BoundingSphere, Bvh, Topology, self_intersecting};
use crate::gltf::{self, ExportParams, ImportLimits};
use crate::pipeline::clock::Clock;
use crate::pipeline::level::Shared;
use crate::pipeline::store::{content_key, shapes_key, vertices_key};
use crate::pipeline::targets::Targets;
use crate::refine::Refined;
use crate::render::{SurfaceSampler, ViewRenderer, posed_views};
use crate::settings::{BakeSettings, ExistingLods, JointPlanes, MorphTargets, SourceGeometry};
use crate::simplify::{self, Shape};
use crate::skinning::{self, SkinSource};
use crate::{Context, Error, PreviewSink, Source, StageId, content_hash};

/// Part of every cache key: raised whenever the output of any stage changes for equal input and settings.
pub const PIPELINE_VERSION: &str = "9";

/// The `opt-level` this crate was compiled with. Below `2` a bake takes many times as long.
pub const OPT_LEVEL: &str = env!("SIMPLIGUARD_OPT_LEVEL");

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
    /// The candidate its shape came by.
    pub candidate: String,
    /// Distance to the source that 95 % of both surfaces stay within, as a fraction of the bounding box's diagonal.
    pub error: f32,
    /// Distances in full.
    pub deviation: Deviation,
    /// Form of its surface.
    pub topology: LevelTopology,
    /// Charts of the atlas.
    pub charts: u32,
    /// Part of the atlas that charts cover.
    pub fill: f32,
    /// L2 stretch of the atlas (Sander et al. 2001) relative to each chart's mean texel density: 1 if lengths are kept.
    pub stretch: f32,
    /// L-infinity stretch: how many times longer than by its chart's mean density a texel is on the surface, at worst.
    pub worst_stretch: f32,
    /// What refinement gained, in dB over held-out views; `None` for a cut-out, which is not refined.
    pub refined: Option<Refined>,
}

/// Form of a level's surface, vertices in one place counted once where they are joined. All levels are manifolds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LevelTopology {
    /// Parts that hang together over edges.
    pub components: u32,
    /// Vertices less edges plus faces: two for each closed part, less two for each handle and one for each hole.
    pub euler_characteristic: i64,
    /// Edges of one face: the rim of sheets, and of holes where nothing sees them.
    pub boundary_edges: u32,
    /// Faces that pass through others.
    pub self_intersecting: u32,
}

impl LevelTopology {
    /// Measures a level.
    pub fn of(mesh: &TriMesh) -> Self {
        let topology = Topology::of(mesh);
        Self {
            components: topology.components as u32,
            euler_characteristic: topology.euler_characteristic,
            boundary_edges: topology.edges.boundary as u32,
            self_intersecting: self_intersecting(mesh).into_iter().filter(|face| *face).count() as u32,
        }
    }
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
    let imported =
        clock.time(StageId::Import, || gltf::import_in(source, &ImportLimits::default(), &context.cancellation));
    if !settings.enabled {
        // What cannot be read is nobody's concern then, but for a glTF that must be made binary.
        let model = if is_binary(source) { imported.ok() } else { Some(imported?) };
        return passed_through(source, model, Status::PassThrough, &clock);
    }
    let model = imported?;
    context.check(source.name)?;
    if model.surface.triangles.is_empty() {
        return passed_through(source, Some(model), Status::PassThrough, &clock);
    }
    if settings.existing_lods == ExistingLods::Keep && gltf::has_levels(&model.document.json) {
        return passed_through(source, Some(model), Status::KeptLods, &clock);
    }
    let faces = model.surface.triangles.len();
    let targets = Targets::new(settings, faces);
    let budgets = targets.budgets();
    if budgets.is_empty() {
        return passed_through(source, Some(model), Status::SmallEnough, &clock);
    }
    check_extent(&model)?;
    let Made { levels, reports, unmet } = make_levels(source, &model, &targets, settings, context, &clock)?;
    context.report(StageId::Export, None, 0.97);
    let params = export_params(settings);
    let export = || gltf::export_in(&model, &levels, &params, PIPELINE_VERSION, &context.cancellation);
    let glb = clock.time(StageId::Export, export)?;
    context.report(StageId::Export, None, 1.0);
    let report = Report {
        status: Status::Baked,
        source_faces: faces as u64,
        levels: reports,
        notes: model.notes.iter().cloned().chain(dropped_morphs(&model, settings)).chain(unmet).collect(),
        seconds: clock.seconds(),
    };
    Ok(Baked { glb, levels, model: Some(model), report })
}

fn export_params(settings: &BakeSettings) -> ExportParams {
    ExportParams { keep_source: settings.source == SourceGeometry::Keep }
}

fn check_extent(model: &Model) -> Result<(), Error> {
    let extent = model.surface.extent();
    if extent >= SMALLEST_EXTENT {
        return Ok(());
    }
    let found = format!("its longest side is {extent:e} metres, below the smallest of {SMALLEST_EXTENT:e}");
    Err(Error::invalid(&model.name, StageId::Import, found, "scale it up; glTF's unit is the metre"))
}

fn is_binary(source: &Source<'_>) -> bool {
    source.bytes.starts_with(b"glTF")
}

/// The source as it is, or as one binary glTF if it is not one yet.
fn passed_through(source: &Source<'_>, model: Option<Model>, status: Status, clock: &Clock) -> Result<Baked, Error> {
    let in_pieces =
        || !is_binary(source) || gltf::external_uris(source.name, source.bytes).is_ok_and(|u| !u.is_empty());
    let packed = model.as_ref().filter(|_| in_pieces()).map(|model| gltf::export(model, &[], &ExportParams::default()));
    Ok(Baked {
        glb: packed.transpose()?.unwrap_or_else(|| source.bytes.to_vec()),
        levels: Vec::new(),
        report: Report {
            status,
            source_faces: model.as_ref().map_or(0, |m| m.surface.triangles.len() as u64),
            levels: Vec::new(),
            notes: model.as_ref().map(|m| m.notes.clone()).unwrap_or_default(),
            seconds: clock.seconds(),
        },
        model,
    })
}

/// Levels, what is said of them, and of targets that none meets.
struct Made {
    levels: Vec<Level>,
    reports: Vec<LevelReport>,
    unmet: Vec<String>,
}

fn make_levels(
    source: &Source<'_>,
    model: &Model,
    targets: &Targets,
    settings: &BakeSettings,
    context: &Context<'_>,
    clock: &Clock,
) -> Result<Made, Error> {
    context.report(StageId::Shape, None, 0.05);
    let surface = &model.surface;
    let frame = BoundingSphere::around(&surface.positions);
    let hash = content_hash(source.bytes);
    let seed = hash.as_bytes()[..8].iter().fold(0u64, |seed, &byte| seed << 8 | u64::from(byte));
    let sampler = SurfaceSampler::new(model);
    let poses = Poses::of(model, settings.poses as usize, posed_views(settings.views), &context.cancellation);
    context.check(&model.name)?;
    let view_renderer = ViewRenderer { sampler: &sampler, frame, poses: poses.as_ref(), seed, settings, context };
    let ((bvh, solid), views) = rayon::join(
        || {
            clock.time(StageId::Shape, || {
                (Bvh::new(&surface.positions, &surface.triangles), simplify::OpaqueSurface::of(&sampler))
            })
        },
        || clock.time(StageId::Refine, || view_renderer.views()),
    );
    context.check(&model.name)?;
    context.report(StageId::Shape, None, 0.15);
    let skin_source = SkinSource::new(model, &bvh);
    let importance = simplify::Importance::of(model, settings)?;
    let deviation_metric = clock.time(StageId::Shape, || simplify::DeviationMetric::new(&solid));
    let inputs = simplify::Inputs {
        model,
        bvh: &bvh,
        skin_source: &skin_source,
        opaque: &solid,
        deviation_metric: &deviation_metric,
        frame,
        views: &views,
        poses: poses.as_ref(),
        importance: importance.as_ref(),
        cancellation: &context.cancellation,
    };
    let budgets = targets.budgets();
    let planes = simplify::JointPlanes {
        planes: joint_planes(model, settings),
        split: settings.joint_planes == JointPlanes::BeforeUnwrap,
    };
    let params = simplify::Params { joint_planes: planes.clone(), ..simplify::Params::new(settings, &budgets) };
    let content = context.key(|| content_key(source, model));
    let preview = context.preview.filter(|_| simplify::is_known(&inputs, &params, context));
    let find_shapes = || {
        let key = content.map(|content| shapes_key(&content, settings));
        clock.time(StageId::Shape, || context.stored(key, || simplify::shape(&inputs, &params, context)))
    };
    let is_refined = |budget: &u32| content.is_some_and(|c| context.knows(&vertices_key(&c, settings, *budget)));
    let take_halves = || {
        let wanted = budgets.iter().any(|budget| level::begins_coarse(*budget) && !is_refined(budget));
        wanted.then(|| clock.time(StageId::Refine, || view_renderer.halves(&views)))
    };
    // The shapes leave threads idle, but what is shown before the vertices are moved should not wait for these views.
    let (shapes, halves) = rayon::join(find_shapes, || preview.is_none().then(take_halves));
    let shapes = shapes?;
    let deviations: Vec<Deviation> = shapes.iter().map(|s| s.deviation).collect();
    context.report(StageId::Unwrap, None, level::LEVELS_BEGIN);
    let shared = Shared {
        model,
        sampler: &sampler,
        bvh: &bvh,
        skin_source: &skin_source,
        deviation_metric: &deviation_metric,
        frame,
        views: &views,
        view_renderer: &view_renderer,
        halves: None,
        poses: poses.as_ref(),
        planes: &planes,
        seed,
        content,
        settings,
        preview: false,
        context,
        clock,
    };
    let (chosen, unmet) = targets.choose(&budgets, &deviations);
    let wanted: Vec<(u32, &Shape)> = chosen.iter().map(|&c| (budgets[c], &shapes[c])).collect();
    if let Some(sink) = preview.filter(|_| !wanted.iter().all(|(budget, _)| is_refined(budget))) {
        show_preview(&shared, &wanted, sink)?;
    }
    let halves = halves.unwrap_or_else(take_halves);
    let (levels, reports) = level::make_levels(&Shared { halves: halves.as_deref(), ..shared }, &wanted)?;
    Ok(Made { levels, reports, unmet })
}

/// Shows levels whose texture is as baked and whose vertices are those of an earlier descent, if there was one, where the result
/// will be refined.
fn show_preview(shared: &Shared<'_>, wanted: &[(u32, &Shape)], sink: &dyn PreviewSink) -> Result<(), Error> {
    let Shared { model, settings, context, clock, .. } = *shared;
    if !settings.refine || settings.refine_steps == 0 {
        return Ok(());
    }
    let quick = BakeSettings { refine: false, ..settings.clone() };
    // What is told of its progress is that of the result.
    let silent = Context { progress: None, ..context.clone() };
    let (levels, _) =
        level::make_levels(&Shared { settings: &quick, context: &silent, preview: true, ..*shared }, wanted)?;
    let params = export_params(settings);
    let export = || gltf::export_in(model, &levels, &params, PIPELINE_VERSION, &silent.cancellation);
    sink.show(clock.time(StageId::Export, export)?);
    Ok(())
}

/// What is said of morph targets that levels leave out.
fn dropped_morphs(model: &Model, settings: &BakeSettings) -> Option<String> {
    let morphs = model.surface.morphs.as_ref().filter(|_| settings.morph_targets == MorphTargets::Drop)?;
    let count = morphs.targets.len();
    Some(format!("{count} morph targets stay at their default weights in the levels: `morph_targets` is Drop"))
}

fn joint_planes(model: &Model, settings: &BakeSettings) -> Vec<skinning::JointPlane> {
    match settings.joint_planes {
        JointPlanes::Off => Vec::new(),
        JointPlanes::BeforeUnwrap | JointPlanes::AfterRefine => skinning::joint_planes(model, settings.joint_delta),
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use glam::Vec3;

    use super::*;
    use crate::{RelativeUri, Resources};

    /// Every file holds one triangle.
    struct Folder;

    impl Resources for Folder {
        fn read(&self, _: &RelativeUri) -> Result<Bytes, String> {
            let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
            Ok(Bytes::from(bytemuck::cast_slice(&corners).to_vec()))
        }
    }

    const IN_PIECES: &str = r#"{"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri": "triangle.bin"}]}"#;

    fn as_glb(json: &str) -> Vec<u8> {
        let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
        let words = [2, 20 + json.len() as u32, json.len() as u32, 0x4E4F_534A];
        [b"glTF", bytemuck::cast_slice(&words), json.as_bytes()].concat()
    }

    #[test]
    fn what_passes_through_needs_no_other_file() {
        for bytes in [IN_PIECES.as_bytes().to_vec(), as_glb(IN_PIECES)] {
            for enabled in [true, false] {
                let settings = BakeSettings { enabled, ..BakeSettings::default() };
                let source = Source { name: "test", bytes: &bytes, resources: &Folder };
                let baked = bake(&source, &settings, &Context::default()).expect("passes");
                assert!(baked.glb.starts_with(b"glTF") && baked.levels.is_empty());
                assert_eq!(gltf::external_uris("test", &baked.glb).expect("glTF"), []);
            }
        }
    }

    #[test]
    fn a_disabled_file_need_not_be_readable() {
        let bytes = as_glb(r#"{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}"#);
        let source = Source { name: "test.glb", bytes: &bytes, resources: &Folder };
        let settings = BakeSettings { enabled: false, ..BakeSettings::default() };
        assert_eq!(bake(&source, &settings, &Context::default()).expect("passes").glb, bytes);
    }

    #[test]
    fn a_model_below_the_range_of_its_areas_is_refused() {
        let mut model = Model::empty("speck.glb");
        model.surface.positions = vec![Vec3::ZERO, Vec3::X * 1e-7, Vec3::Y * 1e-7];
        model.surface.triangles = vec![[0, 1, 2]];
        let error = check_extent(&model).expect_err("too small").to_string();
        assert!(error.starts_with("speck.glb: import: its longest side is 1e-7 metres"), "{error}");
    }
}
