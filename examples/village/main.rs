//! Levels for each object of a scene: a village of 300 objects in one glTF file, drawn with levels and without.
//!
//! ```sh
//! cargo run --example village                    # prints triangles, meshes and frame times, and ends
//! cargo run --example village -- --stay          # stays open: F3 hides the panel, L turns levels on and off
//! xvfb-run cargo run --example village -- --screenshot target/village/pictures
//! xvfb-run cargo run --example village -- --size 180     # a small window, where triangles count more than pixels
//! ```
//!
//! The scene is made here and written to `target/village/assets`, with a `.meta` file that says `scope: Objects`. The game
//! spawns it like any other scene. Its 300 objects are 20 meshes, so there are 20 bakes. Each object switches on its own:
//! from the middle of the village, some show their source and others the smallest level. Seen from afar, one mesh stands for
//! all of them (`whole`). Beside it lies the same scene with levels for the whole file, for comparison.

mod scene;
mod shapes;
#[path = "../shared/timing.rs"]
mod timing;

use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use bevy::asset::AssetMode;
use bevy::asset::io::file::FileAssetReader;
use bevy::light::CascadeShadowConfigBuilder;
use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured, save_to_disk};
use bevy::window::PresentMode;
use bevy_simpliguard::lod::LodMember;
use bevy_simpliguard::overlay::thousands;
use bevy_simpliguard::{
    BakeFailed, BakeMode, LodSettings, LodStats, OverlayPlugin, SimpliguardLods, SimpliguardPlugin,
};
use clap::Parser;

use scene::{LevelsOf, RADIUS};
use timing::{Timer, Timing};

/// The folder of the scene, below that of all assets.
const FOLDER: &str = "target/village";

const AIR: Color = Color::srgb(0.70, 0.80, 0.90);

#[derive(Parser, Resource, Clone)]
struct Options {
    /// A folder for pictures from each place.
    #[arg(long, value_name = "DIR")]
    screenshot: Option<PathBuf>,
    /// Measure nothing and stay open.
    #[arg(long)]
    stay: bool,
    /// Height of the window in pixels.
    #[arg(long, default_value_t = 720)]
    size: u32,
    /// Largest anisotropy of filters; by default 8, and 1 where the renderer runs in software.
    #[arg(long)]
    anisotropy: Option<u16>,
}

/// Where the village is seen from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    Near,
    Middle,
    Far,
    Horizon,
}

impl Place {
    fn view(self) -> Transform {
        let (position, focus) = match self {
            Self::Near => (Vec3::new(4.0, 1.8, 22.0), Vec3::new(0.0, 1.5, 0.0)),
            Self::Middle => (Vec3::new(0.0, 0.3 * RADIUS, 1.3 * RADIUS), Vec3::new(0.0, 0.0, 0.2 * RADIUS)),
            Self::Far => (Vec3::new(0.0, 1.2 * RADIUS, 4.0 * RADIUS), Vec3::ZERO),
            Self::Horizon => (Vec3::new(0.0, 1.5 * RADIUS, 12.0 * RADIUS), Vec3::ZERO),
        };
        Transform::from_translation(position).looking_at(focus, Vec3::Y)
    }
}

fn main() -> AppExit {
    let options = Options::parse();
    let folder = FileAssetReader::get_base_path().join(FOLDER).join("assets");
    for levels in [LevelsOf::Objects, LevelsOf::File] {
        if let Err(error) = scene::write(&folder, levels) {
            return fail(&folder, &error);
        }
    }
    let window = Window {
        title: "village".into(),
        resolution: (options.size * 16 / 9, options.size).into(),
        present_mode: if options.stay { PresentMode::AutoVsync } else { PresentMode::AutoNoVsync },
        ..default()
    };
    let assets = AssetPlugin {
        mode: AssetMode::Processed,
        file_path: format!("{FOLDER}/assets"),
        processed_file_path: format!("{FOLDER}/imported_assets/Default"),
        ..default()
    };
    App::new()
        .add_plugins((
            SimpliguardPlugin { mode: Some(BakeMode::Blocking), anisotropy: options.anisotropy, ..default() },
            DefaultPlugins.set(assets).set(WindowPlugin { primary_window: Some(window), ..default() }),
            OverlayPlugin::default(),
        ))
        .insert_resource(Measurements::new(&options))
        .insert_resource(options)
        .insert_resource(ClearColor(AIR))
        .add_systems(Startup, setup)
        .add_systems(Update, (measure.run_if(has_levels), give_up))
        .add_observer(|_: On<ScreenshotCaptured>, mut all: ResMut<Measurements>| all.is_exposing = false)
        .run()
}

#[expect(clippy::print_stderr, reason = "a program's own message")]
fn fail(folder: &Path, error: &std::io::Error) -> AppExit {
    eprintln!("{}: the village cannot be written: {error}", folder.display());
    AppExit::error()
}

fn setup(
    mut commands: Commands,
    options: Res<Options>,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let village = |levels: LevelsOf| {
        let scene = GltfAssetLabel::Scene(0).from_asset(levels.file());
        (WorldAssetRoot(server.load(scene)), levels)
    };
    commands.spawn(village(LevelsOf::Objects));
    if !options.stay {
        commands.spawn((village(LevelsOf::File), Visibility::Hidden));
    }
    let fog = DistanceFog {
        color: AIR,
        falloff: FogFalloff::Linear { start: 5.0 * RADIUS, end: 20.0 * RADIUS },
        ..default()
    };
    let ambient = AmbientLight { brightness: 500.0, ..default() };
    commands.spawn((Camera3d::default(), fog, ambient, Place::Near.view()));
    commands.spawn((
        DirectionalLight {
            color: Color::srgb(1.0, 0.95, 0.86),
            illuminance: 9_000.0,
            shadow_maps_enabled: true,
            ..default()
        },
        CascadeShadowConfigBuilder { num_cascades: 1, maximum_distance: 3.0 * RADIUS, ..default() }.build(),
        Transform::from_xyz(-5.0, 6.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let grass = StandardMaterial { base_color: Color::srgb(0.33, 0.42, 0.18), perceptual_roughness: 1.0, ..default() };
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(40.0 * RADIUS, 40.0 * RADIUS))),
        MeshMaterial3d(materials.add(grass)),
    ));
}

/// Whether the villages are there with their levels.
fn has_levels(villages: Query<Has<SimpliguardLods>, With<LevelsOf>>) -> bool {
    villages.iter().all(|has_levels| has_levels)
}

fn give_up(mut failed: MessageReader<BakeFailed>, mut exit: MessageWriter<AppExit>) {
    if let Some(bake) = failed.read().next() {
        error!("no village: {}", bake.error);
        exit.write(AppExit::error());
    }
}

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shown {
    /// The levels of each object.
    Levels,
    /// Those of the whole file: one mesh in place of all objects, wherever they are.
    OneLevel,
    Source,
    /// The ground alone: what a frame costs without any object.
    Nothing,
}

impl Shown {
    /// The village that is shown.
    fn village(self) -> Option<LevelsOf> {
        match self {
            Self::Levels | Self::Source => Some(LevelsOf::Objects),
            Self::OneLevel => Some(LevelsOf::File),
            Self::Nothing => None,
        }
    }

    /// The end of the name of its picture.
    fn suffix(self) -> Option<&'static str> {
        match self {
            Self::Levels => Some(""),
            Self::OneLevel => Some("_one_level"),
            Self::Source => Some("_source"),
            Self::Nothing => None,
        }
    }
}

/// What is left to be measured, and what was.
#[derive(Resource)]
struct Measurements {
    left: VecDeque<(Place, Shown)>,
    timer: Timer,
    done: Vec<Measured>,
    is_exposing: bool,
}

#[derive(Clone, Copy)]
struct Measured {
    timing: Timing,
    triangles: u64,
    /// Mesh entities in view.
    entities: usize,
    /// Different pairs of mesh and material among them. What has both in common is drawn in one call.
    draws: usize,
}

impl Measurements {
    fn new(options: &Options) -> Self {
        let each = |place| [Shown::Levels, Shown::OneLevel, Shown::Source, Shown::Nothing].map(|shown| (place, shown));
        let all = [Place::Near, Place::Middle, Place::Far, Place::Horizon].into_iter().flat_map(each);
        let left = if options.stay { VecDeque::new() } else { all.collect() };
        Self { left, timer: Timer::default(), done: Vec::new(), is_exposing: false }
    }
}

impl Measured {
    fn line(&self) -> String {
        let Self { timing: Timing { mean, p95 }, triangles, entities, draws } = self;
        let triangles = thousands(*triangles);
        format!("{triangles} triangles, {entities} meshes in {draws} draws: mean {mean:.1} ms, 95 % {p95:.1} ms")
    }
}

#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn measure(
    mut commands: Commands,
    mut all: ResMut<Measurements>,
    options: Res<Options>,
    time: Res<Time<Real>>,
    stats: Res<LodStats>,
    members: Query<(&ViewVisibility, &Mesh3d, &MeshMaterial3d<StandardMaterial>), With<LodMember>>,
    mut settings: ResMut<LodSettings>,
    mut villages: Query<(&mut Visibility, &LevelsOf)>,
    mut camera: Single<&mut Transform, With<Camera3d>>,
    mut exit: MessageWriter<AppExit>,
) {
    if all.is_exposing || options.stay {
        return;
    }
    let Some(&(place, shown)) = all.left.front() else {
        exit.write(AppExit::Success);
        return;
    };
    camera.set_if_neq(place.view());
    for (mut visibility, levels) in &mut villages {
        let is_shown = shown.village() == Some(*levels);
        visibility.set_if_neq(if is_shown { Visibility::Inherited } else { Visibility::Hidden });
    }
    let enabled = shown != Shown::Source;
    if settings.enabled != enabled {
        settings.enabled = enabled;
    }
    let Some(timing) = all.timer.add(time.delta()) else { return };
    all.left.pop_front();
    let seen: Vec<_> = members.iter().filter(|(v, ..)| v.get()).map(|(_, mesh, of)| (mesh.id(), of.id())).collect();
    let draws = seen.iter().collect::<BTreeSet<_>>().len();
    all.done.push(Measured { timing, triangles: stats.triangles, entities: seen.len(), draws });
    let name = format!("{place:?}").to_lowercase();
    if let Some((folder, suffix)) = options.screenshot.as_ref().zip(shown.suffix()) {
        let _ = std::fs::create_dir_all(folder);
        let path = folder.join(format!("village_{name}{suffix}.png"));
        commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path));
        all.is_exposing = true;
    }
    if let Ok(measured) = all.done[..].try_into() {
        print(&name, measured);
        all.done.clear();
    }
}

#[expect(clippy::print_stdout, reason = "the program's result")]
fn print(place: &str, [levels, one, source, nothing]: [Measured; 4]) {
    let empty = nothing.timing.mean;
    let objects = |measured: Measured| (measured.timing.mean - empty).max(0.0);
    println!("{place}");
    for (name, measured) in [("levels of objects", levels), ("levels of the file", one), ("source", source)] {
        println!("  {name:<20}{}; without the ground {:.1} ms", measured.line(), objects(measured));
    }
    println!("  {:<20}mean {empty:.1} ms", "ground alone");
    println!("  {:.1} times as fast as the source", source.timing.mean / levels.timing.mean);
}
