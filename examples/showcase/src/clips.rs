//! Plays the models' clips, all instances in step, so that levels can be compared in equal poses.

use bevy::gltf::Gltf;
use bevy::prelude::*;

use crate::exhibits::{Collection, Exhibit};

/// Which of its clips each model plays: this one modulo their number.
#[derive(Resource, Default)]
struct ClipChoice(usize);

/// Per model, the graph that holds its clips; `None` until it is loaded, or where there are no clips.
#[derive(Resource, Default)]
struct Graphs(Vec<Option<Graph>>);

struct Graph {
    graph: Handle<AnimationGraph>,
    clips: Vec<(AnimationNodeIndex, Handle<AnimationClip>)>,
}

pub(crate) fn plugin(app: &mut App) {
    app.init_resource::<ClipChoice>().init_resource::<Graphs>();
    app.add_systems(Update, (next, collect, start, change.run_if(resource_changed::<ClipChoice>)).chain());
}

fn next(keys: Res<ButtonInput<KeyCode>>, mut choice: ResMut<ClipChoice>) {
    if keys.just_pressed(KeyCode::KeyC) {
        choice.0 += 1;
    }
}

fn collect(
    collection: Res<Collection>,
    files: Res<Assets<Gltf>>,
    mut graphs: ResMut<Graphs>,
    mut assets: ResMut<Assets<AnimationGraph>>,
) {
    graphs.0.resize_with(collection.models.len(), || None);
    for (model, known) in collection.models.iter().zip(&mut graphs.0) {
        let Some(file) = files.get(&model.gltf) else { continue };
        if known.is_none() && !file.animations.is_empty() {
            let (graph, nodes) = AnimationGraph::from_clips(file.animations.iter().cloned());
            let clips = nodes.into_iter().zip(file.animations.iter().cloned()).collect();
            *known = Some(Graph { graph: assets.add(graph), clips });
        }
    }
}

/// Starts the players that a loaded or replaced instance brings.
#[expect(clippy::too_many_arguments, reason = "a system of Bevy lists what it uses")]
fn start(
    mut commands: Commands,
    mut players: Query<(Entity, &mut AnimationPlayer), Without<AnimationGraphHandle>>,
    parents: Query<&ChildOf>,
    exhibits: Query<&Exhibit>,
    graphs: Res<Graphs>,
    clips: Res<Assets<AnimationClip>>,
    choice: Res<ClipChoice>,
    time: Res<Time>,
) {
    for (entity, mut player) in &mut players {
        let exhibit = parents.iter_ancestors(entity).find_map(|parent| exhibits.get(parent).ok());
        let Some(graph) = exhibit.and_then(|exhibit| graphs.0.get(exhibit.0)?.as_ref()) else { continue };
        commands.entity(entity).insert(AnimationGraphHandle(graph.graph.clone()));
        play(&mut player, graph, &clips, choice.0, time.elapsed_secs());
    }
}

fn change(
    mut players: Query<(&mut AnimationPlayer, &AnimationGraphHandle)>,
    graphs: Res<Graphs>,
    clips: Res<Assets<AnimationClip>>,
    choice: Res<ClipChoice>,
    time: Res<Time>,
) {
    for (mut player, handle) in &mut players {
        if let Some(graph) = graphs.0.iter().flatten().find(|graph| graph.graph.id() == handle.id()) {
            player.stop_all();
            play(&mut player, graph, &clips, choice.0, time.elapsed_secs());
        }
    }
}

/// Plays the chosen clip at the place where it would be had it started with the game.
fn play(player: &mut AnimationPlayer, graph: &Graph, clips: &Assets<AnimationClip>, choice: usize, now: f32) {
    let (node, clip) = &graph.clips[choice % graph.clips.len()];
    let duration = clips.get(clip).map_or(0.0, AnimationClip::duration);
    let offset = if duration > 0.0 { now % duration } else { 0.0 };
    player.play(*node).repeat().seek_to(offset);
}
