//! What happens in the game of [`super::app`] beside loading.

use std::collections::BTreeMap;

use bevy::animation::graph::{AnimationGraph, AnimationGraphHandle};
use bevy::camera::visibility::VisibleEntityRanges;
use bevy::camera::{ComputedCameraValues, RenderTargetInfo};
use bevy::gltf::Gltf;
use bevy::mesh::skinning::{SkinnedMesh, SkinnedMeshInverseBindposes};
use bevy::platform::collections::HashMap;
use bevy::prelude::*;
use bevy_simpliguard::lod::{LodGroup, LodMember, LodSystems};
use serde_json::json;

use super::app::{Clock, Models, say};

/// Viewport of the camera, in pixels.
const HEIGHT: u32 = 720;
/// Each frame the camera is farther away by this factor.
const STEP: f32 = 1.01;

/// A camera that moves away once there are levels.
pub(super) fn move_camera_away(app: &mut App) {
    app.add_systems(Startup, spawn_camera).add_systems(Update, step_back).add_systems(Last, report_ranges);
}

fn spawn_camera(mut commands: Commands) {
    let target_info = Some(RenderTargetInfo { physical_size: UVec2::splat(HEIGHT), scale_factor: 1.0 });
    let clip_from_view = Mat4::perspective_infinite_reverse_rh(1.0, 1.0, 0.1);
    let camera = Camera { computed: ComputedCameraValues { clip_from_view, target_info, ..default() }, ..default() };
    commands.spawn((Camera3d::default(), camera, Transform::from_xyz(0.0, 0.0, 8.0)));
}

fn step_back(groups: Query<(), With<LodGroup>>, mut camera: Single<&mut Transform, With<Camera3d>>) {
    if !groups.is_empty() {
        camera.translation.z *= STEP;
    }
}

/// Tells how many parts of each level are in the camera's range.
fn report_ranges(
    clock: Res<Clock>,
    camera: Single<(Entity, &Transform), With<Camera3d>>,
    members: Query<(Entity, &LodMember)>,
    ranges: Res<VisibleEntityRanges>,
) {
    let (camera, transform) = *camera;
    let mut parts = BTreeMap::<String, u32>::new();
    for (entity, member) in &members {
        if ranges.entity_is_in_range_of_view(entity, camera) {
            *parts.entry(member.level.to_string()).or_default() += 1;
        }
    }
    if !members.is_empty() {
        say(&clock, json!({ "what": "ranges", "distance": transform.translation.z, "parts": parts }));
    }
}

/// Frames per second of the clip.
const FRAME_RATE: f32 = 30.0;

/// The clip that plays, and where it is.
#[derive(Resource)]
struct Clip {
    node: AnimationNodeIndex,
    frames: u32,
    frame: u32,
}

/// Goes through the first clip of the first model frame by frame, again and again.
pub(super) fn play_clip(app: &mut App) {
    app.add_systems(Update, (start_clip, step_clip).chain()).add_systems(PostUpdate, report_joints.after(LodSystems));
}

#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn start_clip(
    mut commands: Commands,
    players: Query<(Entity, &mut AnimationPlayer), Without<AnimationGraphHandle>>,
    models: Res<Models>,
    assets: Res<Assets<Gltf>>,
    clips: Res<Assets<AnimationClip>>,
    mut graphs: ResMut<Assets<AnimationGraph>>,
) {
    let clip = models.0.first().and_then(|(_, handle)| assets.get(handle)?.animations.first().cloned());
    let Some(clip) = clip else { return };
    let Some(duration) = clips.get(&clip).map(AnimationClip::duration) else { return };
    for (entity, mut player) in players {
        let (graph, node) = AnimationGraph::from_clip(clip.clone());
        player.play(node).pause();
        commands.insert_resource(Clip { node, frames: (duration * FRAME_RATE).ceil() as u32 + 1, frame: 0 });
        commands.entity(entity).insert(AnimationGraphHandle(graphs.add(graph)));
    }
}

fn step_clip(mut players: Query<&mut AnimationPlayer>, clip: Option<ResMut<Clip>>) {
    let Some(mut clip) = clip else { return };
    clip.frame = (clip.frame + 1) % clip.frames;
    for mut player in &mut players {
        if let Some(animation) = player.animation_mut(clip.node) {
            animation.seek_to(clip.frame as f32 / FRAME_RATE);
        }
    }
}

/// Tells how far the matrices of the levels' joints are from those of the source's, and where the source's are.
fn report_joints(
    clock: Res<Clock>,
    members: Query<(&LodMember, &SkinnedMesh)>,
    joints: Query<&GlobalTransform>,
    poses: Res<Assets<SkinnedMeshInverseBindposes>>,
    clip: Option<Res<Clip>>,
) {
    let Some(clip) = clip else { return };
    let matrices = |skin: &SkinnedMesh| -> Option<HashMap<Entity, Mat4>> {
        let poses = poses.get(&skin.inverse_bindposes)?;
        let pairs = skin.joints.iter().zip(poses.iter());
        pairs.map(|(&joint, pose)| Some((joint, joints.get(joint).ok()?.to_matrix() * *pose))).collect()
    };
    let mut source = HashMap::new();
    for (_, skin) in members.iter().filter(|(member, _)| member.level == 0) {
        source.extend(matrices(skin).unwrap_or_default());
    }
    let (mut levels, mut apart) = (0, 0.0_f32);
    for (_, skin) in members.iter().filter(|(member, _)| member.level > 0) {
        levels += 1;
        for (joint, matrix) in matrices(skin).unwrap_or_default() {
            apart = apart.max(source.get(&joint).map_or(f32::INFINITY, |m| (*m - matrix).abs_sum()));
        }
    }
    let pose: f32 = source.values().map(|m| m.abs_sum()).sum();
    if levels > 0 {
        let (frame, frames) = (clip.frame, clip.frames);
        let joints = json!({
            "what": "joints", "levels": levels, "apart": apart, "pose": pose, "frame": frame, "frames": frames,
        });
        say(&clock, joints);
    }
}

trait AbsSum {
    fn abs_sum(&self) -> f32;
}

impl AbsSum for Mat4 {
    fn abs_sum(&self) -> f32 {
        self.to_cols_array().iter().map(|x| x.abs()).sum()
    }
}
