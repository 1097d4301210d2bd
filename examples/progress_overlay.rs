//! The panel that shows bakes, levels in view and triangles, in a corner and with keys of the game's choice:
//! `cargo run --example progress_overlay`. With `-- --screenshot DIR` and an empty cache it ends with a picture of a bake under
//! way and one of the result.
//!
//! The panel is the feature `overlay` of the plugin: `features = ["overlay"]` beside its path in `Cargo.toml`. Hidden, it costs
//! nothing, so a game may keep it. What it shows a game can have for itself: the messages `BakeStarted`, `BakeProgress`,
//! `BakeFinished` and `BakeFailed`, and the resource `LodStats`.

#[path = "shared/pictures.rs"]
mod pictures;

use bevy::asset::AssetMode;
use bevy::prelude::*;
use bevy_simpliguard::overlay::{OverlayCorner, OverlayKeys};
use bevy_simpliguard::{
    BakeFailed, BakeFinished, BakeStatus, Bakes, OverlayPlugin, OverlaySettings, SimpliguardPlugin,
};

use pictures::{Pictures, all_have_levels};

fn main() -> AppExit {
    let keys = OverlayKeys { toggle: Some(KeyCode::Backquote), automatic: Some(KeyCode::Digit9), ..default() };
    let settings = OverlaySettings { corner: OverlayCorner::BottomRight, text_size: 16.0, keys, ..default() };
    App::new()
        .add_plugins((
            SimpliguardPlugin::default(),
            DefaultPlugins.set(AssetPlugin { mode: AssetMode::Processed, ..default() }),
            OverlayPlugin { settings },
        ))
        .add_systems(Startup, setup)
        .add_systems(Update, (tell, turn))
        .picture("baking", is_baking)
        .picture("baked", all_have_levels)
        .run()
}

fn setup(mut commands: Commands, server: Res<AssetServer>) {
    commands.spawn((Camera3d::default(), Transform::from_xyz(0.0, 1.6, 4.5).looking_at(Vec3::Y * 0.4, Vec3::Y)));
    commands.spawn((DirectionalLight::default(), Transform::from_xyz(2.0, 4.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y)));
    for (model, x, z) in [("teddy_bear.glb", -1.4, 1.8), ("octopus.glb", -0.9, 1.0), ("pool_table.glb", 0.9, 0.0)] {
        commands.spawn((WorldAssetRoot(server.load(format!("{model}#Scene0"))), Transform::from_xyz(x, 0.0, z)));
    }
}

/// The same as messages, for a game with a user interface of its own.
fn tell(mut finished: MessageReader<BakeFinished>, mut failed: MessageReader<BakeFailed>) {
    for bake in finished.read() {
        info!("{}: {} levels in {:.1} s", bake.path, bake.report.levels.len(), bake.duration.as_secs_f32());
    }
    for bake in failed.read() {
        warn!("{}: {}", bake.path, bake.error);
    }
}

/// Whether a bake is under way.
fn is_baking(bakes: Res<Bakes>) -> bool {
    bakes.iter().any(|(_, status)| matches!(status, BakeStatus::Baking { fraction, .. } if *fraction > 0.4))
}

fn turn(time: Res<Time>, mut models: Query<&mut Transform, With<WorldAssetRoot>>) {
    for mut model in &mut models {
        model.rotate_y(0.4 * time.delta_secs());
    }
}
