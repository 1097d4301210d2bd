//! What a game draws besides, without a window, so that its GPU is at work in each frame.

use std::f32::consts::TAU;

use bevy::app::ScheduleRunnerPlugin;
use bevy::asset::AssetMode;
use bevy::camera::RenderTarget;
use bevy::log::LogPlugin;
use bevy::prelude::*;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::render::render_resource::{PollType, TextureFormat};
use bevy::render::renderer::RenderDevice;
use bevy::render::{Render, RenderApp, RenderSystems};
use serde::Deserialize;

use super::app::{LOG, one_io_thread};
use crate::scene::without_window;

/// Balls on a spiral, under a light with shadows.
#[derive(Deserialize, Resource, Clone, Copy)]
pub(super) struct Drawing {
    balls: u32,
}

/// Subdivisions of a ball, which has 20 (n + 1)² triangles.
const SUBDIVISIONS: u32 = 15;

/// Adds all that a game needs which draws. Each frame ends when the GPU has drawn it.
pub(super) fn add(app: &mut App, drawing: Drawing, runner: ScheduleRunnerPlugin) {
    let plugins = without_window()
        .disable::<PipelinedRenderingPlugin>()
        .set(one_io_thread())
        .set(LogPlugin { filter: LOG.into(), ..default() })
        .set(AssetPlugin { mode: AssetMode::Processed, ..default() });
    app.add_plugins((plugins, runner)).insert_resource(drawing).add_systems(Startup, spawn);
    app.sub_app_mut(RenderApp).add_systems(Render, wait_for_gpu.in_set(RenderSystems::Cleanup));
}

fn wait_for_gpu(device: Res<RenderDevice>) {
    device.poll(PollType::wait_indefinitely()).expect("it draws");
}

fn spawn(
    mut commands: Commands,
    drawing: Res<Drawing>,
    mut images: ResMut<Assets<Image>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let target = images.add(Image::new_target_texture(1920, 1080, TextureFormat::Rgba8UnormSrgb, None));
    let eye = Transform::from_xyz(0.0, 6.0, 12.0).looking_at(Vec3::ZERO, Vec3::Y);
    commands.spawn((Camera3d::default(), RenderTarget::Image(target.into()), eye));
    let light = DirectionalLight { shadow_maps_enabled: true, ..default() };
    commands.spawn((light, Transform::from_xyz(3.0, 4.0, 5.0).looking_at(Vec3::ZERO, Vec3::Y)));
    let ball = Sphere::new(0.1).mesh().ico(SUBDIVISIONS).expect("few enough triangles");
    let (ball, material) = (meshes.add(ball), materials.add(Color::srgb(0.8, 0.3, 0.2)));
    for i in 0..drawing.balls {
        let (part, turns) = (i as f32 / drawing.balls as f32, 20.0);
        let place = 6.0 * part.sqrt() * Vec2::from_angle(part.sqrt() * turns * TAU);
        commands.spawn((
            Mesh3d(ball.clone()),
            MeshMaterial3d(material.clone()),
            Transform::from_xyz(place.x, 0.0, place.y),
        ));
    }
}
