//! The octopuses of the example `crowd`, fifty of them and without a window: they switch, and they move.

#[path = "../../examples/crowd/octopuses.rs"]
mod octopuses;

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use bevy::animation::AnimationPlugin;
use bevy::asset::io::memory::{Dir, MemoryAssetReader};
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::camera::{CameraPlugin, ComputedCameraValues, RenderTargetInfo};
use bevy::ecs::system::RunSystemOnce;
use bevy::gltf::{GltfAssetLabel, GltfPlugin};
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats};
use bevy::mesh::MeshPlugin;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_simpliguard::lod::{LodPlugin, LodSettings, SimpliguardLods};

use self::octopuses::{Crowd, MODEL, Place, complete};
use super::bake::OCTOPUS;

const CROWD: Crowd = Crowd { count: 50 };
/// Textures of the octopus itself, which come before those of its levels.
const SOURCE_TEXTURES: usize = 1;
/// Lines of the window that is not there.
const HEIGHT: u32 = 720;

#[test]
fn fifty_octopuses_switch_by_distance_and_each_moves_on_its_own() {
    let mut app = crowd(CROWD, LodPlugin::default());
    let source = OCTOPUS.report.source_faces * u64::from(CROWD.count);

    // From nearby those in front are finer than those behind; from afar all are the coarsest.
    let near = look(&mut app, Place::Near);
    assert!([1, 2].iter().all(|level| near.iter().any(|(seen, _)| seen == level)), "{near:?}");
    let far = look(&mut app, Place::Far);
    assert!(far.iter().all(|(level, _)| *level == 1), "{far:?}");
    let triangles = |seen: &[(u32, u64)]| seen.iter().map(|(_, triangles)| triangles).sum::<u64>();
    let [near, middle, far] = [triangles(&near), triangles(&look(&mut app, Place::Middle)), triangles(&far)];
    assert!(source > near && near > middle && middle >= far && 10 * far < source, "{source} {near} {middle} {far}");

    // What is seen from afar moves, and no two in step. A pose may return within a swing, a whole third of a second does not.
    let frames: Vec<_> = (0..10).map(|_| (app.update(), poses(&mut app)).1).collect();
    let of_each: Vec<Vec<_>> =
        (0..CROWD.count as usize).map(|i| frames.iter().map(|frame| &frame[i]).collect()).collect();
    assert!(of_each.iter().all(|poses| poses.iter().any(|pose| pose != &poses[0])), "some stand still");
    assert_eq!(of_each.iter().collect::<BTreeSet<_>>().len(), of_each.len(), "some move in step");

    app.world_mut().resource_mut::<LodSettings>().enabled = false;
    assert_eq!(triangles(&look(&mut app, Place::Far)), source);
}

#[test]
fn textures_of_levels_and_source_have_mipmaps() {
    let file = gltf::Gltf::from_slice(&OCTOPUS.glb).expect("glTF");
    assert!(file.textures().len() > SOURCE_TEXTURES, "the levels have no textures");
    for mipmaps in [true, false] {
        let app = crowd(Crowd { count: 1 }, LodPlugin { mipmaps, ..default() });
        let (server, images) = (app.world().resource::<AssetServer>(), app.world().resource::<Assets<Image>>());
        for texture in file.textures() {
            let label = GltfAssetLabel::Texture(texture.index()).from_asset(MODEL);
            let image = server.get_handle(&label).and_then(|handle| images.get(&handle)).expect("it is loaded");
            let all = image.size().max_element().ilog2() + 1;
            assert_eq!(image.texture_descriptor.mip_level_count, if mipmaps { all } else { 1 }, "{label}");
            let texels: u32 =
                (0..image.texture_descriptor.mip_level_count).map(|i| image.size().element_product() >> (2 * i)).sum();
            assert_eq!(image.data.as_ref().map(Vec::len), Some(4 * texels as usize), "{label}");
        }
    }
}

/// The crowd once all of it is there, 30 frames a second.
fn crowd(crowd: Crowd, levels: LodPlugin) -> App {
    let (mut app, dir) = (App::new(), Dir::default());
    dir.insert_asset(Path::new(MODEL), OCTOPUS.glb.clone());
    app.register_asset_source(
        AssetSourceId::Default,
        AssetSourceBuilder::new(move || Box::new(MemoryAssetReader { root: dir.clone() })),
    )
    .add_plugins((
        MinimalPlugins,
        TransformPlugin,
        AssetPlugin::default(),
        ImagePlugin::default(),
        MeshPlugin,
        CameraPlugin,
        WorldSerializationPlugin,
        GltfPlugin::default(),
        AnimationPlugin,
        levels,
        crowd,
    ))
    .insert_resource(CompressedImageFormatSupport(CompressedImageFormats::NONE))
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs(1) / 30));
    app.finish();
    app.cleanup();
    let target_info = Some(RenderTargetInfo { physical_size: UVec2::splat(HEIGHT), scale_factor: 1.0 });
    let clip_from_view = Mat4::perspective_infinite_reverse_rh(std::f32::consts::FRAC_PI_4, 1.0, 0.1);
    let camera = Camera { computed: ComputedCameraValues { clip_from_view, target_info, ..default() }, ..default() };
    app.world_mut().spawn((Camera3d::default(), camera));
    while !app.world_mut().run_system_once(complete).expect("runs") {
        app.update();
        std::thread::sleep(Duration::from_millis(1));
    }
    app
}

/// The level of each octopus from there, and its triangles.
fn look(app: &mut App, place: Place) -> Vec<(u32, u64)> {
    let world = app.world_mut();
    *world.query_filtered::<&mut Transform, With<Camera3d>>().single_mut(world).expect("one camera") =
        place.view(CROWD);
    app.update();
    let world = app.world_mut();
    let faces = |lods: &SimpliguardLods| {
        let level = lods.levels.iter().find(|level| level.level == lods.current).expect("it is listed");
        (lods.current, u64::from(level.faces))
    };
    world.query::<&SimpliguardLods>().iter(world).map(faces).collect()
}

/// How each octopus holds the joints of the level that it shows, whatever it stands on and wherever it looks.
fn poses(app: &mut App) -> Vec<Vec<u32>> {
    let world = app.world_mut();
    let mut crowd = world.query::<(&SimpliguardLods, &GlobalTransform)>();
    let pose = |(lods, place): (&SimpliguardLods, &GlobalTransform)| {
        let level = lods.levels.iter().find(|level| level.level == lods.current).expect("it is listed");
        let skin = world.get::<SkinnedMesh>(level.primitives.first().expect("a mesh").entity).expect("it is skinned");
        let to_place = place.affine().inverse();
        let joints =
            skin.joints.iter().map(|joint| to_place * world.get::<GlobalTransform>(*joint).expect("placed").affine());
        // To a millimetre: each stands elsewhere, which rounds differently.
        joints.flat_map(|joint| joint.to_cols_array()).map(|x| ((1e3 * x).round() as i32).cast_unsigned()).collect()
    };
    crowd.iter(world).map(pose).collect()
}
