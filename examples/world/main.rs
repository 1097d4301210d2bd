//! A world of 1,000 rocks of 50 models, and a flight over it: what it costs to have all sources in memory, and what it costs
//! to load them on demand, and all levels but the smallest too.
//!
//! ```sh
//! cargo run --example world                     # sources and levels on demand; prints figures and ends
//! cargo run --example world -- --keep           # all sources in memory
//! cargo run --example world -- --uncompressed   # the same, with textures as images in place of blocks
//! cargo run --example world -- --plain          # the models as they are, without levels
//! cargo run --example world -- --stay           # stays open
//! xvfb-run cargo run --example world -- --size 320 --screenshot target/world    # without a display
//! ```
//!
//! The models are made here and written to `target/world/assets`, with `.meta` files that say `source: OnDemand`, `source: Keep`
//! or `enabled: false`. Nothing else in the game is special. The first start bakes them; the figures are those of a later one.

mod models;

use std::path::PathBuf;
use std::time::Instant;

use bevy::asset::AssetMode;
use bevy::asset::io::file::FileAssetReader;
use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, save_to_disk};
use bevy::window::PresentMode;
use bevy_simpliguard::{
    BakeMode, BakeStarted, OverlayPlugin, OverlaySettings, SimpliguardLods, SimpliguardPlugin, SourceSettings,
    SourceStats,
};
use clap::{Args, Parser};

/// The folder of the models, below that of all assets.
const FOLDER: &str = "target/world";
/// Rocks in the world, and metres from its middle to its end.
const ROCKS: u32 = 1000;
const RADIUS: f32 = 160.0;
/// Metres a second of the flight, and its height.
const SPEED: f32 = 20.0;
const HEIGHT: f32 = 3.0;
/// Longest step of the flight in seconds: where frames take longer, it is slower.
const LONGEST_STEP: f32 = 0.1;
/// Height of the window in pixels, for which the panel has its usual size.
const SIZE: u32 = 720;
/// Frames after which all shaders are compiled.
const WARM_UP: usize = 5;
/// Metres between two lines of figures.
const INTERVAL: f32 = 20.0;
/// Vertices of the placeholder of a source.
const PLACEHOLDER: usize = 3;

#[derive(Parser, Resource, Clone)]
struct Options {
    #[command(flatten)]
    models: Models,
    /// A folder for pictures of the flight.
    #[arg(long, value_name = "DIR")]
    screenshot: Option<PathBuf>,
    /// Measure nothing and stay open.
    #[arg(long)]
    stay: bool,
    /// Height of the window in pixels.
    #[arg(long, default_value_t = SIZE)]
    size: u32,
    /// Bytes on the GPU that all sources and levels on demand may take, in MiB.
    #[arg(long, default_value_t = 64)]
    budget: u64,
    /// Largest anisotropy of filters; by default 8, and 1 where the renderer runs in software.
    #[arg(long)]
    anisotropy: Option<u16>,
}

/// The form of the models, if it is not that of sources on demand.
#[derive(Args, Clone)]
#[group(multiple = false)]
struct Models {
    /// Keep all sources in memory.
    #[arg(long)]
    keep: bool,
    /// Keep all sources in memory, and textures as images.
    #[arg(long)]
    uncompressed: bool,
    /// Show the models as they are, without levels.
    #[arg(long)]
    plain: bool,
}

impl Models {
    fn setting(&self) -> &'static str {
        match self {
            Self { keep: true, .. } => "source: Keep",
            Self { uncompressed: true, .. } => "source: Keep, texture_compression: Off",
            Self { plain: true, .. } => "enabled: false",
            _ => "source: OnDemand",
        }
    }
}

/// The start of the program, and what was seen since.
#[derive(Resource)]
struct Flight {
    start: Instant,
    is_baking: bool,
    /// Seconds until the first frame.
    first: Option<f32>,
    /// Seconds until all rocks are there.
    ready: Option<f32>,
    /// Metres flown, and those since the last line of figures.
    way: f32,
    since: f32,
    frames: Vec<f32>,
    /// Frames in which a rock showed a placeholder.
    gaps: u32,
    most: u64,
}

fn main() -> AppExit {
    let (options, start) = (Options::parse(), Instant::now());
    let folder = FileAssetReader::get_base_path().join(FOLDER).join("assets");
    if let Err(error) = models::write(&folder, options.models.setting()) {
        return fail(&folder, &error);
    }
    let window = Window {
        title: "world".into(),
        resolution: (options.size * 16 / 9, options.size).into(),
        present_mode: if options.stay { PresentMode::AutoVsync } else { PresentMode::AutoNoVsync },
        ..default()
    };
    let overlay = OverlaySettings::default();
    let overlay = OverlaySettings { text_size: overlay.text_size * options.size as f32 / SIZE as f32, ..overlay };
    let assets = AssetPlugin {
        mode: AssetMode::Processed,
        file_path: format!("{FOLDER}/assets"),
        processed_file_path: format!("{FOLDER}/imported_assets/Default"),
        ..default()
    };
    App::new()
        .insert_resource(SourceSettings { budget: options.budget << 20, ..default() })
        .add_plugins((
            SimpliguardPlugin { mode: Some(BakeMode::Blocking), anisotropy: options.anisotropy, ..default() },
            DefaultPlugins.set(assets).set(WindowPlugin { primary_window: Some(window), ..default() }),
            OverlayPlugin { settings: overlay },
        ))
        .insert_resource(Flight {
            start,
            is_baking: false,
            first: None,
            ready: None,
            way: 0.0,
            since: 0.0,
            frames: Vec::new(),
            gaps: 0,
            most: 0,
        })
        .insert_resource(options)
        .insert_resource(ClearColor(Color::srgb(0.70, 0.75, 0.82)))
        .add_systems(Startup, setup)
        .add_systems(Update, (wait, fly.run_if(is_ready)).chain())
        .add_systems(Last, (look_for_gaps, note_first_frame))
        .run()
}

#[expect(clippy::print_stderr, reason = "a program's own message")]
fn fail(folder: &std::path::Path, error: &std::io::Error) -> AppExit {
    eprintln!("{}: the models cannot be written: {error}", folder.display());
    AppExit::error()
}

fn setup(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let scene = |model: usize| server.load(format!("{}#Scene0", models::name(model)));
    let scenes: Vec<Handle<WorldAsset>> = (0..models::COUNT).map(scene).collect();
    for rock in 0..ROCKS {
        let scene = scenes[rock as usize % models::COUNT].clone();
        // Like the seeds of a sunflower: evenly, and in no direction in rows.
        let (sin, cos) = (2.399_963 * rock as f32).sin_cos();
        let away = RADIUS * (rock as f32 / ROCKS as f32).sqrt();
        let place =
            Transform::from_xyz(away * cos, 0.0, away * sin).with_scale(Vec3::splat(0.6 + models::chance(rock)));
        commands.spawn((WorldAssetRoot(scene), place));
    }
    commands.spawn((Camera3d::default(), view(0.0)));
    commands.spawn((DirectionalLight::default(), Transform::from_xyz(-5.0, 6.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y)));
    let ground = StandardMaterial { base_color: Color::srgb(0.45, 0.38, 0.30), perceptual_roughness: 1.0, ..default() };
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(40.0 * RADIUS, 40.0 * RADIUS))),
        MeshMaterial3d(materials.add(ground)),
    ));
}

/// The view after so many metres: straight over the world.
fn view(way: f32) -> Transform {
    let eye = Vec3::new(0.35, HEIGHT, RADIUS + 20.0 - way);
    Transform::from_translation(eye).looking_at(eye + Vec3::new(0.0, -0.25, -1.0), Vec3::Y)
}

fn is_ready(flight: Res<Flight>, options: Res<Options>) -> bool {
    flight.ready.is_some() && !options.stay
}

/// Waits until every rock is there with its levels.
#[expect(clippy::print_stdout, reason = "the program's result")]
fn wait(
    mut flight: ResMut<Flight>,
    mut bakes: MessageReader<BakeStarted>,
    options: Res<Options>,
    (rocks, drawn): (Query<&SimpliguardLods>, Query<&Mesh3d>),
    (meshes, images): (Res<Assets<Mesh>>, Res<Assets<Image>>),
) {
    flight.is_baking |= bakes.read().count() > 0;
    let there = match options.models.plain {
        // One is the ground.
        true => drawn.iter().count() - 1,
        false => rocks.iter().filter(|lods| !lods.levels.is_empty()).count(),
    };
    if flight.ready.is_some() || there < ROCKS as usize {
        return;
    }
    let seconds = flight.start.elapsed().as_secs_f32();
    flight.ready = Some(seconds);
    if flight.is_baking {
        println!("the models were baked: start again for the time to the first frame");
    }
    let first = flight.first.unwrap_or(seconds);
    println!(
        "the first frame after {first:.2} s, all rocks after {seconds:.2} s, {} on the GPU, {} resident",
        mib(on_gpu(&meshes, &images)),
        mib(memory("VmRSS:"))
    );
}

fn note_first_frame(mut flight: ResMut<Flight>) {
    if flight.first.is_none() {
        flight.first = Some(flight.start.elapsed().as_secs_f32());
    }
}

/// Flies over the world.
#[expect(clippy::print_stdout, reason = "the program's result")]
fn fly(
    mut commands: Commands,
    mut flight: ResMut<Flight>,
    (options, time, stats): (Res<Options>, Res<Time<Real>>, Res<SourceStats>),
    mut camera: Single<&mut Transform, With<Camera3d>>,
    mut exit: MessageWriter<AppExit>,
) {
    let seconds = time.delta_secs();
    let step = SPEED * seconds.min(LONGEST_STEP);
    flight.way += step;
    flight.since += step;
    **camera = view(flight.way);
    flight.frames.push(seconds);
    flight.most = flight.most.max(stats.bytes);
    if flight.since >= INTERVAL {
        flight.since = 0.0;
        let SourceStats { models, resident, levels, bytes, .. } = *stats;
        println!("{:5.0} m: {resident} of {models} sources and {levels} levels, {}", flight.way, mib(bytes));
        if let Some(folder) = &options.screenshot {
            let _ = std::fs::create_dir_all(folder);
            let path = folder.join(format!("world_{:03.0}.png", flight.way));
            commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path));
        }
    }
    if flight.way > 2.0 * RADIUS + 40.0 {
        let mut frames: Vec<f32> = flight.frames.iter().skip(WARM_UP).map(|seconds| 1000.0 * seconds).collect();
        frames.sort_by(f32::total_cmp);
        let (mean, last) = (frames.iter().sum::<f32>() / frames.len() as f32, frames.len().saturating_sub(1));
        println!(
            "{} frames: mean {mean:.1} ms, 99 % {:.1} ms, longest {:.1} ms; {} with a gap; at most {} of sources and levels; {} resident, at most {}",
            frames.len(),
            frames[last * 99 / 100],
            frames[last],
            flight.gaps,
            mib(flight.most),
            mib(memory("VmRSS:")),
            mib(memory("VmHWM:")),
        );
        exit.write(AppExit::Success);
    }
}

/// Counts frames in which a rock shows its source or a level while that is away.
fn look_for_gaps(mut flight: ResMut<Flight>, rocks: Query<&SimpliguardLods>, meshes: Res<Assets<Mesh>>) {
    let has_gap = |lods: &SimpliguardLods| {
        let shown = lods.levels.iter().filter(|level| level.level == lods.current);
        let mut parts = shown.flat_map(|level| &level.primitives);
        parts.any(|part| meshes.get(&part.mesh).is_none_or(|mesh| mesh.count_vertices() <= PLACEHOLDER))
    };
    if rocks.iter().any(has_gap) {
        flight.gaps += 1;
    }
}

fn mib(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

/// Bytes of all meshes and textures.
fn on_gpu(meshes: &Assets<Mesh>, images: &Assets<Image>) -> u64 {
    let mesh = |mesh: &Mesh| mesh.get_vertex_buffer_size() + mesh.get_index_buffer_bytes().map_or(0, <[u8]>::len);
    let meshes = meshes.iter().map(|(_, each)| mesh(each)).sum::<usize>();
    let images = images.iter().filter_map(|(_, image)| image.data.as_ref()).map(Vec::len).sum::<usize>();
    (meshes + images) as u64
}

/// Bytes of the process in memory, by the name of a line of `/proc/self/status`. Zero where the system does not tell.
fn memory(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(name));
    1024 * line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0)
}
