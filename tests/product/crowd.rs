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
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats, ImageSampler};
use bevy::mesh::MeshPlugin;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::prelude::*;
use bevy::render::render_resource::TextureFormat;
use bevy::time::TimeUpdateStrategy;
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_simpliguard::lod::{LodGroup, LodPlugin, LodSettings, ModelMemory, SimpliguardLods, memory_of};
use simpliguard::Cancellation;
use simpliguard::gltf::compress_textures;
use simpliguard_texture::{mipmap_count, mipmap_size};

use self::octopuses::{Crowd, MODEL, Place, complete};
use super::bake::OCTOPUS;
use super::blocks::{line_error, mean_square};

const CROWD: Crowd = Crowd { count: 50 };
/// Textures of the octopus itself, which come before those of its levels.
const SOURCE_TEXTURES: usize = 1;
/// Anisotropy of the filters of a game whose renderer does not run in software.
const ANISOTROPY: u16 = 8;
/// Mean squared error that blocks may have above that of lines: endpoints and steps between them are rounded.
const ROUNDING: f64 = 1.0;
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

/// The file as the plugin leaves it for a game.
fn in_blocks() -> Vec<u8> {
    compress_textures(MODEL, &OCTOPUS.glb, &Cancellation::default()).expect("a baked file")
}

/// The images of all textures of an octopus in a game whose GPU takes these formats, and the memory of source and levels.
fn textures_of(glb: Vec<u8>, formats: CompressedImageFormats) -> (Vec<Image>, ModelMemory) {
    let mut app = crowd_of(glb, formats, Crowd { count: 1 }, LodPlugin::default());
    let world = app.world_mut();
    let groups: Vec<LodGroup> = world.query::<&LodGroup>().iter(world).cloned().collect();
    let (server, images) = (world.resource::<AssetServer>(), world.resource::<Assets<Image>>());
    let mut memory = memory_of(&groups, world.resource::<Assets<Mesh>>(), images);
    let file = gltf::Gltf::from_slice(&OCTOPUS.glb).expect("glTF");
    let labels = file.textures().map(|texture| GltfAssetLabel::Texture(texture.index()).from_asset(MODEL));
    let image = |label| server.get_handle(&label).and_then(|handle| images.get(&handle)).expect("it is loaded").clone();
    (labels.map(image).collect(), memory.pop().expect("one model"))
}

#[test]
fn textures_of_levels_and_source_have_the_same_filter() {
    let anisotropy = |image: &Image| match &image.sampler {
        ImageSampler::Descriptor(sampler) => sampler.anisotropy_clamp,
        ImageSampler::Default => 1,
    };
    for glb in [in_blocks(), OCTOPUS.glb.clone()] {
        let (images, _) = textures_of(glb, CompressedImageFormats::BC);
        assert!(images.len() > SOURCE_TEXTURES);
        assert!(images.iter().all(|image| anisotropy(image) == ANISOTROPY));
    }
}

#[test]
fn textures_in_blocks_take_a_quarter_of_the_memory() {
    let (blocks, small) = textures_of(in_blocks(), CompressedImageFormats::BC);
    let (texels, large) = textures_of(OCTOPUS.glb.clone(), CompressedImageFormats::BC);
    for (blocks, texels) in blocks.iter().zip(&texels) {
        let (blocks, texels) = (&blocks.texture_descriptor, &texels.texture_descriptor);
        let expected = match texels.format {
            TextureFormat::Rgba8UnormSrgb => TextureFormat::Bc7RgbaUnormSrgb,
            _ => TextureFormat::Bc7RgbaUnorm,
        };
        assert_eq!((blocks.format, blocks.size), (expected, texels.size));
        assert_eq!(blocks.mip_level_count, texels.mip_level_count);
    }
    for (small, large) in [(small.source, large.source), (small.levels, large.levels)] {
        let gain = large.textures as f64 / small.textures as f64;
        assert!((3.99..=4.0).contains(&gain), "{large:?} became {small:?}");
    }
}

#[test]
fn without_a_gpu_for_blocks_textures_are_the_same_texels() {
    let (decoded, memory) = textures_of(in_blocks(), CompressedImageFormats::NONE);
    let (texels, plain) = textures_of(OCTOPUS.glb.clone(), CompressedImageFormats::NONE);
    assert_eq!(memory, plain);
    for (a, b) in decoded.iter().zip(&texels) {
        assert_eq!(a.texture_descriptor, b.texture_descriptor);
        assert_eq!(a.sampler, b.sampler);
        let (size, mut start) = (b.size(), 0);
        let (a, b) = (a.data.as_ref().expect("texels"), b.data.as_ref().expect("texels"));
        assert_eq!(a.len(), b.len());
        for number in 0..mipmap_count(size) {
            let size = mipmap_size(size, number);
            let mipmap = start..start + 4 * size.element_product() as usize;
            let (decoded, texels) = (&a[mipmap.clone()], &b[mipmap.clone()]);
            let (error, of_lines) = (mean_square(decoded, texels), line_error(texels, size));
            assert!(error <= of_lines + ROUNDING, "mipmap {number} of {size}: {error}, lines {of_lines}");
            start = mipmap.end;
        }
    }
}

/// The crowd once all of it is there, 30 frames a second.
fn crowd(crowd: Crowd, levels: LodPlugin) -> App {
    crowd_of(OCTOPUS.glb.clone(), CompressedImageFormats::NONE, crowd, levels)
}

/// As [`crowd`], with this file as its model, and for a GPU that takes these formats.
fn crowd_of(glb: Vec<u8>, formats: CompressedImageFormats, crowd: Crowd, levels: LodPlugin) -> App {
    let (mut app, dir) = (App::new(), Dir::default());
    dir.insert_asset(Path::new(MODEL), glb);
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
    .insert_resource(CompressedImageFormatSupport(formats))
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
