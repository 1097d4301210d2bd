//! Sources that are loaded when a camera comes near, in a game without a window.

use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;

use bevy::animation::AnimationPlugin;
use bevy::asset::io::memory::{Dir, MemoryAssetReader};
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::camera::visibility::VisibilityRange;
use bevy::camera::{CameraPlugin, ComputedCameraValues, RenderTargetInfo};
use bevy::gltf::{Gltf, GltfPlugin};
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats};
use bevy::mesh::MeshPlugin;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_simpliguard::lod::{
    LodGroup, LodLevel, LodPlugin, LodSettings, LodStats, LodView, OnDemand, SimpliguardLods, SourceSettings,
    SourceStats,
};
use simpliguard::Cancellation;
use simpliguard::gltf::{Divided, compress_textures, divide};

use super::bake::OCTOPUS;

/// A distance at which the source is seen, and one at which the smallest level is.
const NEAR: f32 = 1.0;
const FAR: f32 = 500.0;
/// The numbers of the parts of the octopus: its source, and a level. The smallest level, 1, is always there.
const LEVELS: [u32; 2] = [0, 2];
/// Vertices of a placeholder.
const PLACEHOLDER: usize = 3;
/// Frames in which anything that is to happen has happened.
const PATIENCE: usize = 5000;

/// The octopus as a game imports it with `source: OnDemand`.
static DIVIDED: LazyLock<Divided> = LazyLock::new(|| {
    let whole = compress_textures("octopus.glb", &OCTOPUS.glb, &Cancellation::default()).expect("a baked file");
    divide("octopus.glb", &whole).expect("a baked file").expect("it has a source and levels")
});

/// A game with octopuses, each of another file.
struct Game {
    app: App,
    octopuses: Vec<Entity>,
    files: Dir,
    /// Held, as what a game plays the clips of.
    models: Vec<Handle<Gltf>>,
}

impl Game {
    /// An octopus at each of these places. Of what is loaded on demand, only these levels have files.
    fn new(places: &[Vec3], there: &[u32]) -> Self {
        let (mut app, [models, sources]) = (App::new(), [Dir::default(), Dir::default()]);
        let files = models.clone();
        for i in 0..places.len() {
            models.insert_asset(Path::new(&format!("{i}.glb")), DIVIDED.levels.clone());
            for (_, part) in DIVIDED.parts.iter().enumerate().filter(|(k, _)| there.contains(&LEVELS[*k])) {
                let path = format!("{i}.glb/{}", part.name);
                sources.insert_asset(Path::new(&path), part.bytes.clone());
            }
        }
        for (id, root) in [(AssetSourceId::Default, models), ("on_demand".into(), sources)] {
            let reader = move || Box::new(MemoryAssetReader { root: root.clone() }) as Box<_>;
            app.register_asset_source(id, AssetSourceBuilder::new(reader));
        }
        app.add_plugins((
            MinimalPlugins,
            TransformPlugin,
            AssetPlugin::default(),
            ImagePlugin::default(),
            MeshPlugin,
            CameraPlugin,
            WorldSerializationPlugin,
            GltfPlugin::default(),
            AnimationPlugin,
            LodPlugin::default(),
        ))
        .insert_resource(CompressedImageFormatSupport(CompressedImageFormats::BC))
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs(1) / 30));
        app.finish();
        app.cleanup();
        let target_info = Some(RenderTargetInfo { physical_size: UVec2::splat(720), scale_factor: 1.0 });
        let clip_from_view = Mat4::perspective_infinite_reverse_rh(std::f32::consts::FRAC_PI_4, 1.0, 0.1);
        let camera =
            Camera { computed: ComputedCameraValues { clip_from_view, target_info, ..default() }, ..default() };
        app.world_mut().spawn((Camera3d::default(), camera, Transform::from_xyz(0.0, 0.0, FAR)));
        let server = app.world().resource::<AssetServer>();
        let models = (0..places.len()).map(|i| server.load(format!("{i}.glb"))).collect();
        let mut game = Self { app, octopuses: Vec::new(), files, models };
        // Bevy may load a file twice that is asked for twice before it is there, and then spawns its scene twice.
        game.run_until("the files", |game| {
            let loaded = game.app.world().resource::<Assets<Gltf>>();
            game.models.iter().all(|model| loaded.contains(model))
        });
        for (i, place) in places.iter().enumerate() {
            let world = game.app.world_mut();
            let scene = world.resource::<AssetServer>().load(format!("{i}.glb#Scene0"));
            game.octopuses.push(world.spawn((WorldAssetRoot(scene), Transform::from_translation(*place))).id());
        }
        game.run_until("all are there", |game| {
            game.octopuses.iter().all(|octopus| game.lods(*octopus).is_some_and(|lods| !lods.levels.is_empty()))
        });
        game
    }

    fn one() -> Self {
        Self::new(&[Vec3::ZERO], &LEVELS)
    }

    fn look_from(&mut self, distance: f32) {
        self.look_at_from(Vec3::Z * distance);
    }

    fn look_at_from(&mut self, place: Vec3) {
        let world = self.app.world_mut();
        world.query_filtered::<&mut Transform, With<Camera3d>>().single_mut(world).expect("one").translation = place;
    }

    /// A frame. Whatever is shown in it is a model, and the budget is kept.
    fn frame(&mut self) {
        self.app.update();
        let stats = self.stats();
        let budget = self.app.world().resource::<SourceSettings>().budget;
        assert!(stats.bytes <= budget, "{stats:?} of {budget}");
        let world = self.app.world_mut();
        let groups: Vec<LodGroup> = world.query::<&LodGroup>().iter(world).cloned().collect();
        for group in groups {
            let drawn = group.levels.iter().filter_map(|level| Some((level, self.shown(level)?)));
            let drawn: Vec<(&LodLevel, bool)> = drawn.collect();
            let is_real = |level: &LodLevel| self.vertices(level).iter().all(|count| *count > PLACEHOLDER);
            let has_whole = drawn.iter().any(|(level, is_whole)| *is_whole && is_real(level));
            let fades = drawn.len() == 2 && drawn.iter().all(|(level, _)| is_real(level));
            assert!(has_whole || fades, "{drawn:?}");
        }
    }

    /// Tells whether a level is drawn, and if so, whether all its pixels are.
    fn shown(&self, level: &LodLevel) -> Option<bool> {
        let range = self.app.world().get::<VisibilityRange>(level.primitives.first()?.entity).expect("it has a range");
        let is_whole = range.start_margin.end < 0.0 && range.end_margin.start > 0.0;
        range.is_visible_at_all(1.0).then_some(is_whole)
    }

    /// The numbers of vertices of the meshes of a level.
    fn vertices(&self, level: &LodLevel) -> Vec<usize> {
        let meshes = self.app.world().resource::<Assets<Mesh>>();
        level.primitives.iter().map(|part| meshes.get(&part.mesh).expect("it is loaded").count_vertices()).collect()
    }

    #[track_caller]
    fn run_until(&mut self, what: &str, is_done: impl Fn(&Self) -> bool) {
        for _ in 0..PATIENCE {
            self.frame();
            if is_done(self) {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        panic!("never: {what}; {:?}", self.stats());
    }

    fn run_for(&mut self, seconds: f32) {
        (0..(30.0 * seconds) as usize).for_each(|_| self.frame());
    }

    fn lods(&self, octopus: Entity) -> Option<&SimpliguardLods> {
        self.app.world().get(octopus)
    }

    fn current(&self, i: usize) -> u32 {
        self.lods(self.octopuses[i]).expect("it has levels").current
    }

    fn stats(&self) -> SourceStats {
        *self.app.world().resource::<SourceStats>()
    }

    fn settings(&mut self) -> Mut<'_, SourceSettings> {
        self.app.world_mut().resource_mut::<SourceSettings>()
    }

    /// Vertices of the source, and sides of its textures.
    fn source(&mut self) -> (usize, Vec<u32>) {
        let world = self.app.world_mut();
        let source = world.query::<&OnDemand>().iter(world).next().expect("a source on demand").parts[0].clone();
        let (meshes, images) = (world.resource::<Assets<Mesh>>(), world.resource::<Assets<Image>>());
        let vertices = source.meshes.iter().map(|mesh| meshes.get(mesh).expect("there").count_vertices()).sum();
        (vertices, source.textures.iter().map(|texture| images.get(texture).expect("there").width()).collect())
    }
}

#[test]
fn the_triangles_of_what_is_away_are_known() {
    let mut game = Game::one();
    game.frame();
    let world = game.app.world_mut();
    let group = world.query::<&LodGroup>().single(world).expect("one").clone();
    let faces = |level: &LodLevel| (level.level, u64::from(level.primitives.iter().map(|p| p.faces).sum::<u32>()));
    let found: Vec<(u32, u64)> = group.levels.iter().map(faces).collect();
    let levels = OCTOPUS.report.levels.iter().rev().map(|level| (level.level, u64::from(level.faces)));
    let expected: Vec<(u32, u64)> = std::iter::once((0, OCTOPUS.report.source_faces)).chain(levels).collect();
    assert_eq!(found, expected);
    assert_eq!(world.resource::<LodStats>().source_triangles, OCTOPUS.report.source_faces);
}

#[test]
fn a_source_comes_with_a_camera_and_goes_some_time_after_it() {
    let mut game = Game::one();
    let octopus = game.octopuses[0];
    let handles: Vec<Handle<Mesh>> =
        game.lods(octopus).expect("levels").levels[0].primitives.iter().map(|part| part.mesh.clone()).collect();
    game.run_for(1.0);
    assert_eq!((game.source(), game.stats().bytes), ((PLACEHOLDER, vec![1]), 0));
    assert_eq!(game.stats(), SourceStats { models: 1, ..default() });

    // The smallest level is there at once, and then the source.
    game.look_from(NEAR);
    game.frame();
    assert_eq!(game.current(0), 1);
    game.run_until("the source", |game| game.current(0) == 0);
    game.run_for(1.0);
    let (vertices, textures) = game.source();
    assert!(vertices > 1000 && textures == [1024], "{vertices} {textures:?}");
    let expected = SourceStats { models: 1, resident: 1, levels: 1, bytes: game.stats().bytes, ..default() };
    assert_eq!(game.stats(), expected);
    // Blocks of all mipmaps of both, and 8 KiB for each of 1,000 vertices would be a lot.
    assert!((1_398_128..2 * 1_398_128 + 8 * 1024 * 1000).contains(&expected.bytes), "{expected:?}");
    let level = game.lods(octopus).expect("levels").levels[0].clone();
    assert!(level.primitives.iter().map(|part| &part.mesh).eq(&handles));
    assert_eq!(game.shown(&level), Some(true));

    // It stays for a while, and can be seen again at once.
    game.look_from(FAR);
    game.run_for(4.0);
    assert_eq!((game.current(0), game.stats().resident), (1, 1));
    game.look_from(NEAR);
    game.frame();
    assert_eq!(game.current(0), 0);
    game.look_from(FAR);
    game.run_for(6.5);
    assert_eq!((game.source(), game.stats()), ((PLACEHOLDER, vec![1]), SourceStats { models: 1, ..default() }));

    // And it comes again.
    game.look_from(NEAR);
    game.run_until("the source again", |game| game.current(0) == 0);
    game.run_for(1.0);
    assert_eq!(game.source(), (vertices, textures));
}

#[test]
fn a_camera_that_comes_fast_finds_the_source_there() {
    let mut game = Game::one();
    let mut distance = FAR;
    let mut first = None;
    while distance > NEAR {
        distance -= 0.5;
        game.look_from(distance);
        game.frame();
        std::thread::sleep(Duration::from_millis(2));
        let stats = game.stats();
        if first.is_none() && stats.loading + stats.resident > 0 {
            first = Some((distance, game.current(0)));
        }
    }
    // 15 metres a second, and two seconds ahead.
    let (first, level) = first.expect("it was loaded");
    assert!(level > 0 && first > 20.0, "{first} m, level {level}");
    assert_eq!((game.stats().resident, game.current(0)), (1, 0));
}

#[test]
fn sources_keep_to_the_budget_and_the_nearest_comes_first() {
    let mut game = Game::new(&[Vec3::ZERO, Vec3::X * 0.4], &[0]);
    game.look_at_from(Vec3::new(-0.4, 0.0, 0.0));
    game.run_until("both", |game| game.stats().resident == 2);
    let bytes = game.stats().bytes;
    // One has to go, the other stays.
    game.settings().budget = bytes / 2;
    // The budget is for what is loaded from now on; what is seen fades out first.
    game.app.update();
    (0..60).for_each(|_| game.app.update());
    assert_eq!(game.stats().bytes, bytes / 2);
    game.run_for(1.0);
    assert_eq!([0, 1].map(|i| game.current(i) == 0), [true, false]);
    game.look_at_from(Vec3::new(0.8, 0.0, 0.0));
    game.run_until("the other", |game| game.current(1) == 0);
    assert_eq!([0, 1].map(|i| game.current(i) == 0), [false, true]);
    game.settings().budget = bytes / 2 - 1;
    (0..60).for_each(|_| game.app.update());
    game.run_for(1.0);
    assert_eq!((game.stats().bytes, game.stats().resident), (0, 0));
}

#[test]
fn a_reload_keeps_models_in_view_and_brings_their_source_again() {
    let mut game = Game::one();
    game.look_from(NEAR);
    game.run_until("the source", |game| game.current(0) == 0);
    let before = game.source();
    for seconds in [0.0, 2.0] {
        game.run_for(seconds);
        game.app.world().resource::<AssetServer>().reload("0.glb");
        game.run_until("the placeholders of the new file", |game| game.stats().resident == 0);
        game.run_until("the source again", |game| {
            let is_there = game.lods(game.octopuses[0]).is_some_and(|lods| !lods.levels.is_empty());
            is_there && game.stats().resident == 1 && game.current(0) == 0
        });
        game.run_for(1.0);
        assert_eq!(game.source(), before);
    }
}

#[test]
fn a_source_that_cannot_be_loaded_leaves_the_most_detailed_level() {
    let mut game = Game::new(&[Vec3::ZERO], &[2]);
    game.look_from(NEAR);
    game.run_until("a failure", |game| game.stats().failed == 1);
    game.run_for(2.0);
    assert_eq!((game.current(0), game.source()), (2, (PLACEHOLDER, vec![1])));
    assert_eq!(game.stats(), SourceStats { models: 1, failed: 1, levels: 1, bytes: game.stats().bytes, ..default() });
}

#[test]
fn a_level_comes_before_the_source_and_stays_while_that_is_seen() {
    let mut game = Game::one();
    let switches: Vec<f32> = {
        let world = game.app.world_mut();
        let group = world.query::<&LodGroup>().single(world).expect("one").clone();
        let view = LodView { height: 720.0, fov: std::f32::consts::FRAC_PI_4 };
        [1, 2].map(|slot| group.switch_distance(slot, 1.0, view, &LodSettings::default())).to_vec()
    };
    // Between the place where the most detailed level is alone and the one where the smallest begins.
    game.look_from(0.3 * switches[0] + 0.7 * switches[1]);
    game.run_until("the level", |game| game.current(0) == 2);
    game.run_for(1.0);
    let with_level = game.stats();
    assert_eq!(with_level, SourceStats { models: 1, levels: 1, bytes: with_level.bytes, ..default() });
    game.look_from(NEAR);
    game.run_until("the source", |game| game.current(0) == 0);
    game.run_for(6.0);
    assert_eq!((game.stats().resident, game.stats().levels), (1, 1));
    assert!(game.stats().bytes > with_level.bytes);
    game.look_from(FAR);
    game.run_for(6.5);
    assert_eq!((game.current(0), game.stats()), (1, SourceStats { models: 1, ..default() }));
}

#[test]
fn a_level_that_cannot_be_loaded_leaves_the_smallest_until_the_source_is_there() {
    let mut game = Game::new(&[Vec3::ZERO], &[0]);
    game.look_from(NEAR);
    game.frame();
    assert_eq!(game.current(0), 1);
    game.run_until("the source", |game| game.current(0) == 0);
    game.run_for(1.0);
    assert_eq!((game.stats().resident, game.stats().levels), (1, 0));
}

#[test]
fn the_scene_of_a_level_has_it_at_once() {
    let mut game = Game::one();
    let scene = {
        let gltf = game.app.world().resource::<Assets<Gltf>>().get(&game.models[0]).expect("loaded");
        gltf.named_scenes["LOD2"].clone()
    };
    game.app.world_mut().spawn(WorldAssetRoot(scene));
    game.run_until("the level", |game| game.stats().levels == 1);
    assert_eq!((game.stats().resident, game.current(0)), (0, 1));
}

#[test]
fn another_version_of_a_model_has_another_source() {
    let mut game = Game::one();
    // Bevy takes changes of the first frames for part of the first load.
    game.run_for(0.5);
    let mut other = DIVIDED.levels.clone();
    let name = DIVIDED.parts[0].name.as_bytes();
    let place = other.windows(name.len()).position(|bytes| bytes == name).expect("it names the source");
    other[place] = if name[0] == b'0' { b'1' } else { b'0' };
    game.files.insert_asset(Path::new("0.glb"), other);
    game.app.world().resource::<AssetServer>().reload("0.glb");
    game.look_from(NEAR);
    game.run_until("a failure", |game| game.stats().failed == 1);
    game.run_for(1.0);
    assert_eq!(game.current(0), 2);
    // The next version of the model has its source.
    game.files.insert_asset(Path::new("0.glb"), DIVIDED.levels.clone());
    game.app.world().resource::<AssetServer>().reload("0.glb");
    game.run_until("the source", |game| game.stats().resident == 1);
}

#[test]
fn a_source_that_a_game_forces_is_loaded() {
    let mut game = Game::one();
    let octopus = game.octopuses[0];
    game.app.world_mut().get_mut::<SimpliguardLods>(octopus).expect("levels").force = Some(0);
    game.run_until("the source from afar", |game| game.current(0) == 0);
    game.app.world_mut().get_mut::<SimpliguardLods>(octopus).expect("levels").force = Some(1);
    game.look_from(NEAR);
    game.run_for(6.0);
    assert_eq!((game.stats().resident, game.current(0)), (0, 1));
}

#[test]
fn a_skinned_source_moves_with_the_clip_that_its_levels_play() {
    let mut game = Game::one();
    let file = game.models[0].clone();
    let world = game.app.world_mut();
    let clip = world.resource::<Assets<Gltf>>().get(&file).expect("loaded").animations[0].clone();
    let (graph, node) = AnimationGraph::from_clip(clip);
    let graph = world.resource_mut::<Assets<AnimationGraph>>().add(graph);
    let (entity, mut player) = world.query::<(Entity, &mut AnimationPlayer)>().single_mut(world).expect("a player");
    player.play(node).repeat();
    world.entity_mut(entity).insert(AnimationGraphHandle(graph));
    let level = game.lods(game.octopuses[0]).expect("levels").levels[0].clone();
    let part = level.primitives[0].entity;
    let joints = game.app.world().get::<SkinnedMesh>(part).expect("it is skinned").joints.clone();
    let pose = |game: &Game| -> Vec<Mat4> {
        joints
            .iter()
            .map(|joint| game.app.world().get::<GlobalTransform>(*joint).expect("placed").to_matrix())
            .collect()
    };
    game.look_from(NEAR);
    game.run_until("the source", |game| game.current(0) == 0);
    let before = pose(&game);
    game.run_for(0.4);
    assert_ne!(before, pose(&game));
    // Nobody has touched the skin, nor the player.
    assert_eq!(game.app.world().get::<SkinnedMesh>(part).expect("it is skinned").joints, joints);
    assert!(game.app.world().get::<AnimationPlayer>(entity).is_some_and(|player| player.is_playing_animation(node)));
    let meshes = game.app.world().resource::<Assets<Mesh>>();
    let mesh = meshes.get(&level.primitives[0].mesh).expect("it is there");
    assert!(
        mesh.contains_attribute(Mesh::ATTRIBUTE_JOINT_INDEX) && mesh.contains_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT)
    );
}
