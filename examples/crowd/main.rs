//! What levels of detail are worth: a crowd of animated octopuses, drawn with them and without.
//!
//! ```sh
//! cargo run --example crowd                          # 1,000 octopuses; prints frame times and ends
//! cargo run --example crowd -- --count 50 --stay     # stays open: F3 hides the panel, L turns levels on and off
//! xvfb-run cargo run --example crowd -- --screenshot target/crowd    # without a display; with pictures
//! ```
//!
//! Nothing in a game is special to levels. Here it is `LodSettings::enabled`, which turns all of them off and on, and the
//! wait for `SimpliguardLods::levels`, which are known once an instance has levels. `BakeMode::Blocking` holds the model
//! back until then: the first start bakes it, later ones take the result from the cache.

mod octopuses;
#[path = "../shared/timing.rs"]
mod timing;

use std::collections::VecDeque;
use std::path::PathBuf;

use bevy::asset::AssetMode;
use bevy::camera::Hdr;
use bevy::light::CascadeShadowConfigBuilder;
use bevy::prelude::*;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured, save_to_disk};
use bevy::window::PresentMode;
use bevy_simpliguard::overlay::thousands;
use bevy_simpliguard::{BakeFailed, BakeMode, LodSettings, LodStats, OverlayPlugin, SimpliguardPlugin};
use clap::Parser;

use octopuses::{Crowd, MODEL, Place, complete};
use timing::{Timer, Timing};

#[derive(Parser, Resource, Clone)]
struct Options {
    /// Number of octopuses.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u16).range(1..))]
    count: u16,
    /// A folder for pictures from near, the middle and afar.
    #[arg(long, value_name = "DIR")]
    screenshot: Option<PathBuf>,
    /// Measure nothing and stay open.
    #[arg(long)]
    stay: bool,
}

fn main() -> AppExit {
    let options = Options::parse();
    let window = Window {
        title: "crowd".into(),
        resolution: (1280, 720).into(),
        present_mode: if options.stay { PresentMode::AutoVsync } else { PresentMode::AutoNoVsync },
        ..default()
    };
    App::new()
        .add_plugins((
            SimpliguardPlugin { mode: Some(BakeMode::Blocking), ..default() },
            DefaultPlugins
                .set(AssetPlugin { mode: AssetMode::Processed, ..default() })
                .set(WindowPlugin { primary_window: Some(window), ..default() }),
            OverlayPlugin::default(),
            Crowd { count: options.count },
        ))
        .insert_resource(Measurements::new(&options))
        .insert_resource(options)
        .insert_resource(ClearColor(AIR))
        .add_systems(Startup, light)
        .add_systems(Update, (measure.run_if(complete), give_up))
        .add_observer(|_: On<ScreenshotCaptured>, mut all: ResMut<Measurements>| all.is_exposing = false)
        .run()
}

const AIR: Color = Color::srgb(0.66, 0.80, 0.93);

fn light(
    mut commands: Commands,
    crowd: Res<Crowd>,
    mut images: ResMut<Assets<Image>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let radius = crowd.radius();
    let sky = EnvironmentMapLight {
        intensity: 900.0,
        ..EnvironmentMapLight::hemispherical_gradient(
            &mut images,
            Color::srgb(0.75, 0.86, 1.0),
            Color::srgb(0.84, 0.88, 0.90),
            Color::srgb(0.70, 0.62, 0.50),
        )
    };
    let fog = DistanceFog {
        color: AIR,
        falloff: FogFalloff::Linear { start: 4.0 * radius, end: 50.0 * radius },
        ..default()
    };
    commands.spawn((Camera3d::default(), Hdr, sky, fog, Place::Near.view(*crowd)));
    commands.spawn((
        DirectionalLight {
            color: Color::srgb(1.0, 0.95, 0.86),
            illuminance: 10_000.0,
            shadow_maps_enabled: true,
            ..default()
        },
        CascadeShadowConfigBuilder { num_cascades: 1, maximum_distance: 4.0 * radius, ..default() }.build(),
        Transform::from_xyz(-5.0, 6.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    let sand = StandardMaterial {
        base_color: Color::srgb(0.76, 0.68, 0.54),
        perceptual_roughness: 0.95,
        reflectance: 0.2,
        ..default()
    };
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(200.0 * radius, 200.0 * radius))),
        MeshMaterial3d(materials.add(sand)),
    ));
}

fn give_up(mut failed: MessageReader<BakeFailed>, mut exit: MessageWriter<AppExit>) {
    if let Some(bake) = failed.read().find(|bake| bake.path.to_string() == MODEL) {
        error!("no crowd: {}", bake.error);
        exit.write(AppExit::error());
    }
}

/// What is left to be measured, and what was.
#[derive(Resource)]
struct Measurements {
    left: VecDeque<(Place, bool)>,
    timer: Timer,
    /// With the triangles that were drawn.
    with_levels: Option<(Timing, u64)>,
    is_exposing: bool,
}

impl Measurements {
    fn new(options: &Options) -> Self {
        let both = |place| [(place, true), (place, false)];
        let all = [Place::Near, Place::Middle, Place::Far].into_iter().flat_map(both);
        let left = if options.stay { VecDeque::new() } else { all.collect() };
        Self { left, timer: Timer::default(), with_levels: None, is_exposing: false }
    }
}

#[expect(clippy::print_stdout, reason = "the program's result")]
#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn measure(
    mut commands: Commands,
    mut all: ResMut<Measurements>,
    (options, crowd): (Res<Options>, Res<Crowd>),
    time: Res<Time<Real>>,
    stats: Res<LodStats>,
    mut settings: ResMut<LodSettings>,
    mut camera: Single<&mut Transform, With<Camera3d>>,
    mut exit: MessageWriter<AppExit>,
) {
    if all.is_exposing || options.stay {
        return;
    }
    let Some(&(place, enabled)) = all.left.front() else {
        exit.write(AppExit::Success);
        return;
    };
    camera.set_if_neq(place.view(*crowd));
    if settings.enabled != enabled {
        settings.enabled = enabled;
    }
    let Some(timing) = all.timer.add(time.delta()) else { return };
    let result = (timing, stats.triangles);
    all.left.pop_front();
    if enabled {
        all.with_levels = Some(result);
        if let Some(folder) = &options.screenshot {
            let _ = std::fs::create_dir_all(folder);
            let path = folder.join(format!("crowd_{place:?}.png").to_lowercase());
            commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path));
            all.is_exposing = true;
        }
    } else if let Some(with) = all.with_levels.take() {
        let name = format!("{place:?}").to_lowercase();
        let line = |(timing, triangles): (Timing, u64)| {
            format!("{} triangles: mean {:.1} ms, 95 % {:.1} ms", thousands(triangles), timing.mean, timing.p95)
        };
        println!("{name}, {} octopuses", thousands(crowd.count.into()));
        println!("  levels of detail   {}", line(with));
        println!("  source             {}", line(result));
        println!("  {:.1} times as fast", timing.mean / with.0.mean);
    }
}
