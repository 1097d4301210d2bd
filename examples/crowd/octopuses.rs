//! The octopuses, and the places they are seen from.

use std::f32::consts::{PI, TAU};

use bevy::gltf::{Gltf, GltfAssetLabel};
use bevy::prelude::*;
use bevy_simpliguard::SimpliguardLods;

pub(crate) const MODEL: &str = "octopus.glb";

/// Distance between neighbours, roughly, in metres.
const SPACING: f32 = 0.65;

/// Spawns a crowd that moves.
#[derive(Resource, Clone, Copy)]
pub(crate) struct Crowd {
    pub(crate) count: u16,
}

impl Plugin for Crowd {
    fn build(&self, app: &mut App) {
        app.insert_resource(*self).add_systems(Startup, spawn).add_systems(Update, animate);
    }
}

impl Crowd {
    /// Metres from its middle to its end.
    pub(crate) fn radius(self) -> f32 {
        SPACING * f32::from(self.count).sqrt()
    }
}

/// The crowd's clips, in one graph that all players share.
#[derive(Resource)]
struct Clips {
    file: Handle<Gltf>,
    graph: Option<(Handle<AnimationGraph>, Vec<AnimationNodeIndex>)>,
}

/// Octopuses like the seeds of a sunflower: evenly, and in no direction in rows.
fn spawn(mut commands: Commands, server: Res<AssetServer>, crowd: Res<Crowd>) {
    let scene: Handle<WorldAsset> = server.load(GltfAssetLabel::Scene(0).from_asset(MODEL));
    commands.insert_resource(Clips { file: server.load(MODEL), graph: None });
    let golden_angle = PI * (3.0 - 5.0_f32.sqrt());
    for i in 0..crowd.count {
        let i = f32::from(i);
        let (sin, cos) = (golden_angle * i).sin_cos();
        let place = SPACING * (i + 0.5).sqrt() * Vec3::new(cos, 0.0, sin);
        let turn = Quat::from_rotation_y(TAU * (0.618 * i).fract());
        commands.spawn((WorldAssetRoot(scene.clone()), Transform::from_translation(place).with_rotation(turn)));
    }
}

/// Starts each octopus somewhere in one of its clips, so that no two move in step.
fn animate(
    mut commands: Commands,
    mut clips: ResMut<Clips>,
    files: Res<Assets<Gltf>>,
    mut graphs: ResMut<Assets<AnimationGraph>>,
    mut players: Query<(Entity, &mut AnimationPlayer), Without<AnimationGraphHandle>>,
) {
    if players.is_empty() {
        return;
    }
    let Some(file) = files.get(&clips.file) else { return };
    let (graph, nodes) = clips.graph.get_or_insert_with(|| {
        let (graph, nodes) = AnimationGraph::from_clips(file.animations.iter().cloned());
        (graphs.add(graph), nodes)
    });
    for (i, (entity, mut player)) in players.iter_mut().enumerate() {
        player.play(nodes[i % nodes.len()]).repeat().seek_to((0.618 * i as f32).fract());
        commands.entity(entity).insert(AnimationGraphHandle(graph.clone()));
    }
}

/// Whether every octopus is there and has levels.
pub(crate) fn complete(lods: Query<&SimpliguardLods>, crowd: Res<Crowd>) -> bool {
    lods.iter().filter(|lods| !lods.levels.is_empty()).count() == usize::from(crowd.count)
}

/// Where the crowd is seen from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Place {
    Near,
    Middle,
    Far,
}

impl Place {
    pub(crate) fn view(self, crowd: Crowd) -> Transform {
        let radius = crowd.radius();
        let (height, distance, focus) = match self {
            Self::Near => (1.0, radius + 1.2, radius - 3.0),
            Self::Middle => (0.35 * radius + 1.0, 1.5 * radius + 1.0, 0.25 * radius),
            Self::Far => (0.9 * radius + 1.0, 2.4 * radius + 2.0, 0.0),
        };
        Transform::from_xyz(0.0, height, distance).looking_at(Vec3::Z * focus, Vec3::Y)
    }
}
