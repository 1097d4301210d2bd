//! The room: ground, steps, light and air.

use bevy::camera::Hdr;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::light::{CascadeShadowConfigBuilder, NotShadowCaster};
use bevy::prelude::*;
use bevy::render::view::{ColorGrading, ColorGradingGlobal};

use crate::camera::Orbit;
use crate::exhibits::Collection;
use crate::layout;

/// The horizon's colour, which distance fades to.
const AIR: Color = Color::srgb(0.66, 0.80, 0.93);

pub(crate) fn plugin(app: &mut App) {
    app.insert_resource(ClearColor(AIR));
    app.add_systems(Startup, (light, ground, camera));
    app.add_systems(PostStartup, steps);
}

fn light(mut commands: Commands) {
    commands.spawn((
        DirectionalLight {
            color: Color::srgb(1.0, 0.96, 0.9),
            illuminance: 14_000.0,
            shadow_maps_enabled: true,
            ..default()
        },
        CascadeShadowConfigBuilder {
            num_cascades: 3,
            first_cascade_far_bound: 12.0,
            maximum_distance: 60.0,
            ..default()
        }
        .build(),
        Transform::from_xyz(-5.0, 9.0, 7.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

fn ground(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>, mut materials: ResMut<Assets<StandardMaterial>>) {
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(1_000.0, 1_000.0))),
        MeshMaterial3d(materials.add(matte(Color::srgb(0.34, 0.36, 0.38)))),
        NotShadowCaster,
    ));
}

/// One step per model, behind and above the one before it. The first row stands on the ground.
fn steps(
    mut commands: Commands,
    collection: Res<Collection>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let material = materials.add(matte(Color::srgb(0.50, 0.49, 0.46)));
    for model in 1..collection.models.len() {
        let place = layout::row(model);
        let size = Vec3::new(layout::row_width(4), place.y, layout::STEP.x);
        commands.spawn((
            Mesh3d(meshes.add(Cuboid::from_size(size))),
            MeshMaterial3d(material.clone()),
            Transform::from_translation(place - Vec3::Y * (place.y / 2.0)),
        ));
    }
}

fn camera(mut commands: Commands, mut images: ResMut<Assets<Image>>, collection: Res<Collection>) {
    commands.spawn((
        Camera3d::default(),
        // The sky goes through the same tone mapping as the ground that fades into it.
        Hdr,
        Orbit::looking(collection.views()[0].1),
        Tonemapping::TonyMcMapface,
        // The tone mapping takes colour away.
        ColorGrading { global: ColorGradingGlobal { post_saturation: 1.2, ..default() }, ..default() },
        EnvironmentMapLight {
            intensity: 600.0,
            ..EnvironmentMapLight::hemispherical_gradient(
                &mut images,
                Color::srgb(0.80, 0.88, 1.0),
                Color::srgb(0.85, 0.86, 0.87),
                Color::srgb(0.52, 0.50, 0.48),
            )
        },
        DistanceFog { color: AIR, falloff: FogFalloff::Linear { start: 40.0, end: 220.0 }, ..default() },
    ));
}

fn matte(color: Color) -> StandardMaterial {
    StandardMaterial { base_color: color, perceptual_roughness: 0.95, reflectance: 0.2, ..default() }
}
