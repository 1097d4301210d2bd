//! The least a game needs for levels of detail: `cargo run --example minimal`.

use bevy::asset::AssetMode;
use bevy::prelude::*;
use bevy_simpliguard::SimpliguardPlugin;

fn main() -> AppExit {
    let assets = AssetPlugin { mode: AssetMode::Processed, ..default() };
    App::new().add_plugins((SimpliguardPlugin::default(), DefaultPlugins.set(assets))).add_systems(Startup, setup).run()
}

fn setup(mut commands: Commands, server: Res<AssetServer>) {
    commands.spawn((Camera3d::default(), Transform::from_xyz(2.0, 2.0, 4.0).looking_at(Vec3::Y * 0.5, Vec3::Y)));
    commands.spawn((DirectionalLight::default(), Transform::from_xyz(2.0, 4.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y)));
    commands.spawn(WorldAssetRoot(server.load("octopus.glb#Scene0")));
}
