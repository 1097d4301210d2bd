//! The game that the tests start: no window, a renderer only where something is to be drawn, every model of the asset folder
//! loaded and spawned.

#![expect(clippy::print_stdout, reason = "reports to the test that started it")]

use std::io::{Read, stdin};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use bevy::animation::AnimationPlugin;
use bevy::app::{ScheduleRunnerPlugin, TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy};
use bevy::asset::io::Writer;
use bevy::asset::io::file::FileAssetReader;
use bevy::asset::processor::{Process, ProcessContext, ProcessError};
use bevy::asset::{AssetLoadFailedEvent, AssetMode, AsyncWriteExt};
use bevy::camera::CameraPlugin;
use bevy::camera::primitives::MeshAabb;
use bevy::gltf::{Gltf, GltfAssetLabel, GltfMesh, GltfPlugin};
use bevy::image::{ImageLoader, ImageLoaderSettings};
use bevy::log::LogPlugin;
use bevy::mesh::MeshPlugin;
use bevy::prelude::*;
use bevy::tasks::ComputeTaskPool;
use bevy::world_serialization::{WorldAssetRoot, WorldInstanceReady, WorldSerializationPlugin};
use bevy_simpliguard::{
    BakeBackend, BakeFailed, BakeFinished, BakeMode, BakePriority, BakeProgress, BakeStarted, BakeStatus, Bakes,
    SimpliguardPlugin, SourceStats,
};
use serde::Deserialize;
use serde_json::{Value, json};

use super::drawing::{self, Drawing};
use super::model::png;
use super::project::files_below;
use super::scenes;

/// The name of the test that is the game.
pub(super) const NAME: &str = "plugin::app::game";
/// The variable with the options.
pub(super) const OPTIONS: &str = "SIMPLIGUARD_TEST_GAME";
/// What the game logs.
pub(super) const LOG: &str = "info,bevy_asset=debug,bevy_simpliguard=debug";
/// In front of every report.
pub(super) const REPORT: &str = "@ ";

/// What a test wants of the game.
#[derive(Deserialize, Resource, Clone, Default)]
#[serde(default)]
pub(super) struct Options {
    /// Without the plugin.
    plain: bool,
    blocking: bool,
    isolate: bool,
    threads: Option<usize>,
    priority: Priority,
    /// Pictures are processed too, by something that makes them black.
    blacken_pictures: bool,
    scene: Option<Scene>,
    work: Option<Work>,
    drawing: Option<Drawing>,
    /// Bakes on the GPU.
    gpu: bool,
    /// Most milliseconds of the GPU for bakes in a frame.
    gpu_ms: Option<f64>,
}

/// Tests run beside others: what stands back behind those may wait for long.
#[derive(Deserialize, Clone, Copy, Default)]
pub(super) enum Priority {
    Lowest,
    Low,
    #[default]
    Normal,
}

/// What a game does besides, in each of its frames.
#[derive(Deserialize, Clone, Copy)]
pub(super) struct Work {
    /// Milliseconds of work that each of two threads has.
    milliseconds: f64,
    /// Shortest frame in milliseconds.
    frame: f64,
}

/// What happens in the game besides.
#[derive(Deserialize, Clone, Copy, PartialEq)]
pub(super) enum Scene {
    /// A camera moves away from the models; what is in its range is told.
    CameraMovesAway,
    /// The first clip of the model plays; what its joints do to source and levels is told.
    ClipPlays,
}

#[derive(Resource)]
pub(super) struct Clock {
    start: Instant,
    last: Instant,
    worst: Duration,
    /// Frames without a bake and beside one.
    frames: [Vec<Duration>; 2],
}

#[derive(Resource)]
pub(super) struct Models(pub(super) Vec<(String, Handle<Gltf>)>);

#[test]
#[ignore = "the game that the other tests start"]
fn game() {
    let Ok(options) = std::env::var(OPTIONS) else { return };
    let options: Options = ron::from_str(&options).expect("options");
    // Ends the line that the test runner has begun.
    println!();
    let mut app = App::new();
    if !options.plain {
        app.add_plugins(SimpliguardPlugin {
            mode: options.blocking.then_some(BakeMode::Blocking),
            threads: options.threads,
            isolate: Some(options.isolate),
            backend: options.gpu.then_some(BakeBackend::Gpu),
            gpu_time: options.gpu_ms.map(|ms| Duration::from_secs_f64(ms / 1000.0)),
            priority: Some(match options.priority {
                Priority::Lowest => BakePriority::Lowest,
                Priority::Low => BakePriority::Low,
                Priority::Normal => BakePriority::Normal,
            }),
            ..default()
        })
        .add_systems(Update, report_bakes);
    }
    let frame = options.work.map_or(Duration::from_millis(4), |work| Duration::from_secs_f64(work.frame / 1000.0));
    let runner = ScheduleRunnerPlugin::run_loop(frame);
    match options.drawing {
        Some(drawing) => drawing::add(&mut app, drawing, runner),
        None => add_plugins_without_renderer(&mut app, runner),
    }
    if options.blacken_pictures {
        app.register_asset_processor(Blacken).set_default_asset_processor::<Blacken>("png");
    }
    match options.scene {
        Some(Scene::CameraMovesAway) => scenes::move_camera_away(&mut app),
        Some(Scene::ClipPlays) => scenes::play_clip(&mut app),
        None => {}
    }
    if let Some(work) = options.work {
        let rounds = work.milliseconds * rounds_per_millisecond();
        app.add_systems(Update, move || {
            ComputeTaskPool::get().scope(|scope| (0..2).for_each(|_| scope.spawn(async move { spin(rounds as u64) })));
        });
    }
    let now = Instant::now();
    app.insert_resource(options)
        .insert_resource(Clock { start: now, last: now, worst: Duration::ZERO, frames: default() })
        .insert_resource(QuitAsked(quit_asked()))
        .add_systems(Startup, load)
        .add_systems(Update, (time_frames, report_models, report_sources, quit))
        .add_observer(report_instance);
    assert!(app.run().is_success());
}

fn add_plugins_without_renderer(app: &mut App, runner: ScheduleRunnerPlugin) {
    app.add_plugins((
        MinimalPlugins.set(runner).set(one_io_thread()),
        LogPlugin { filter: LOG.into(), ..default() },
        AssetPlugin { mode: AssetMode::Processed, ..default() },
        TransformPlugin,
        ImagePlugin::default(),
        MeshPlugin,
        CameraPlugin,
        WorldSerializationPlugin,
        GltfPlugin::default(),
        AnimationPlugin,
    ));
}

/// Stands for whatever a game does with its pictures.
#[derive(TypePath)]
struct Blacken;

impl Process for Blacken {
    type Settings = ();
    type OutputLoader = ImageLoader;

    async fn process(
        &self,
        _: &mut ProcessContext<'_>,
        (): &(),
        writer: &mut Writer,
    ) -> Result<ImageLoaderSettings, ProcessError> {
        let written = writer.write_all(&png([0; 3])).await;
        written.map_err(|error| ProcessError::AssetSaveError(error.into()))?;
        Ok(ImageLoaderSettings::default())
    }
}

/// What waits for something in Bevy's processor holds everything up then, as on any machine of two cores.
pub(super) fn one_io_thread() -> TaskPoolPlugin {
    let one = TaskPoolThreadAssignmentPolicy {
        min_threads: 1,
        max_threads: 1,
        percent: 0.25,
        on_thread_spawn: None,
        on_thread_destroy: None,
    };
    TaskPoolPlugin { task_pool_options: TaskPoolOptions { io: one, ..default() } }
}

/// Set when standard input ends.
#[derive(Resource)]
struct QuitAsked(Arc<AtomicBool>);

fn quit_asked() -> Arc<AtomicBool> {
    let asked = Arc::new(AtomicBool::new(false));
    let flag = asked.clone();
    thread::spawn(move || {
        let _ = stdin().read_to_end(&mut Vec::new());
        flag.store(true, Ordering::Relaxed);
    });
    asked
}

/// Reports something to the test.
pub(super) fn say(clock: &Clock, mut report: Value) {
    report["t"] = json!(clock.start.elapsed().as_secs_f64());
    println!("{REPORT}{report}");
}

fn load(mut commands: Commands, server: Res<AssetServer>) {
    let folder = FileAssetReader::get_base_path().join("assets");
    let is_model = |path: &Path| path.extension().is_some_and(|e| e == "glb" || e == "gltf");
    let mut models = Vec::new();
    for file in files_below(&folder).iter().filter(|f| is_model(f)) {
        let path = file.strip_prefix(&folder).expect("below").to_string_lossy().into_owned();
        commands.spawn((
            WorldAssetRoot(server.load(GltfAssetLabel::Scene(0).from_asset(path.clone()))),
            Name::new(path.clone()),
        ));
        models.push((path.clone(), server.load(path)));
    }
    commands.insert_resource(Models(models));
}

fn time_frames(mut clock: ResMut<Clock>, bakes: Option<Res<Bakes>>) {
    let is_baking =
        bakes.is_some_and(|bakes| bakes.iter().any(|(_, status)| matches!(status, BakeStatus::Baking { .. })));
    let now = Instant::now();
    let frame = now - clock.last;
    clock.worst = clock.worst.max(frame);
    clock.frames[usize::from(is_baking)].push(frame);
    clock.last = now;
}

/// Work for one core.
fn spin(rounds: u64) {
    let hash = |x: u64, i: u64| (x ^ i).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    std::hint::black_box((0..rounds).fold(1, hash));
}

fn rounds_per_millisecond() -> f64 {
    const ROUNDS: u64 = 1_000_000;
    let times = (0..20).map(|_| {
        let start = Instant::now();
        spin(ROUNDS);
        start.elapsed().as_secs_f64() * 1000.0
    });
    ROUNDS as f64 / times.fold(f64::INFINITY, f64::min)
}

/// Mean, the time that 95 % of them take at most, and the longest, in milliseconds. The first frames are those of the start.
fn summary(frames: &[Duration]) -> Value {
    let mut times: Vec<f64> = frames.iter().skip(20).map(|frame| 1000.0 * frame.as_secs_f64()).collect();
    times.sort_by(f64::total_cmp);
    let Some(last) = times.last() else { return Value::Null };
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    json!({ "mean": mean, "p95": times[(times.len() * 95).div_ceil(100) - 1], "worst": last })
}

#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn report_bakes(
    clock: Res<Clock>,
    bakes: Res<Bakes>,
    mut started: MessageReader<BakeStarted>,
    mut progress: MessageReader<BakeProgress>,
    mut finished: MessageReader<BakeFinished>,
    mut failed: MessageReader<BakeFailed>,
) {
    for message in started.read() {
        say(&clock, json!({ "what": "started", "path": message.path.to_string() }));
    }
    for message in progress.read() {
        let (path, fraction) = (message.path.to_string(), message.fraction);
        say(&clock, json!({ "what": "progress", "path": path, "fraction": fraction }));
    }
    for message in finished.read() {
        let seconds = message.duration.as_secs_f64();
        let (path, triangles) = (message.path.to_string(), message.report.source_faces);
        say(&clock, json!({ "what": "finished", "path": path, "seconds": seconds, "triangles": triangles }));
    }
    for message in failed.read() {
        say(&clock, json!({ "what": "failed", "path": message.path.to_string(), "error": message.error }));
    }
    if bakes.is_changed() && bakes.is_settled() {
        say(&clock, json!({ "what": "settled", "models": bakes.iter().count() }));
    }
}

#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn report_models(
    clock: Res<Clock>,
    models: Res<Models>,
    (assets, gltf_meshes, meshes): (Res<Assets<Gltf>>, Res<Assets<GltfMesh>>, Res<Assets<Mesh>>),
    mut events: MessageReader<AssetEvent<Gltf>>,
    mut failures: MessageReader<AssetLoadFailedEvent<Gltf>>,
    mut all: Local<bool>,
) {
    let path_of = |id: AssetId<Gltf>| models.0.iter().find(|(_, h)| h.id() == id).map(|(path, _)| path);
    for event in events.read() {
        let AssetEvent::LoadedWithDependencies { id } = event else { continue };
        let (Some(gltf), Some(path)) = (assets.get(*id), path_of(*id)) else { continue };
        let count = |is_counted: &dyn Fn(&str) -> bool| gltf.named_nodes.keys().filter(|name| is_counted(name)).count();
        let levels = count(&|name| name.starts_with("LOD") && !name.contains(' '));
        let of_all = count(&|name| name.starts_with("Whole LOD"));
        let of_objects = count(&|name| name.contains(" LOD")) - of_all;
        let sizes = gltf.meshes.iter().filter_map(|mesh| gltf_meshes.get(mesh)).flat_map(|mesh| &mesh.primitives);
        let boxes = sizes.filter_map(|part| meshes.get(&part.mesh)?.compute_aabb());
        let size = boxes.map(|aabb| aabb.half_extents.length()).fold(0.0, f32::max);
        let loaded = json!({
            "what": "loaded", "path": path, "levels": levels, "levels of objects": of_objects, "levels of all": of_all,
            "size": size,
        });
        say(&clock, loaded);
    }
    if !*all && models.0.iter().all(|(_, handle)| assets.contains(handle)) {
        *all = true;
        say(&clock, json!({ "what": "all loaded" }));
    }
    for failure in failures.read() {
        let kept = assets.contains(failure.id);
        say(&clock, json!({ "what": "load failed", "path": failure.path.to_string(), "kept": kept }));
    }
}

/// A game without the plugin has no sources.
fn report_sources(clock: Res<Clock>, stats: Option<Res<SourceStats>>, mut last: Local<SourceStats>) {
    let Some(stats) = stats.filter(|stats| **stats != *last) else { return };
    *last = *stats;
    say(&clock, json!({ "what": "sources", "resident": stats.resident, "failed": stats.failed }));
}

fn report_instance(ready: On<WorldInstanceReady>, clock: Res<Clock>, names: Query<&Name>) {
    let name = names.get(ready.entity).map(Name::to_string).unwrap_or_default();
    say(&clock, json!({ "what": "instance", "path": name }));
}

fn quit(asked: Res<QuitAsked>, clock: Res<Clock>, mut exit: MessageWriter<AppExit>) {
    if asked.0.load(Ordering::Relaxed) {
        say(
            &clock,
            json!({
                "what": "end", "worst_frame": clock.worst.as_secs_f64(),
                "alone": summary(&clock.frames[0]), "baking": summary(&clock.frames[1]),
            }),
        );
        exit.write(AppExit::Success);
    }
}
