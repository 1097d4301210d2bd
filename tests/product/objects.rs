//! A file that was baked with levels for each object, in Bevy without a window: they hang on their object and switch.

use std::path::Path;
use std::time::Duration;

use bevy::animation::AnimationPlugin;
use bevy::asset::io::memory::{Dir, MemoryAssetReader};
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::camera::CameraPlugin;
use bevy::gltf::{GltfAssetLabel, GltfPlugin};
use bevy::image::{CompressedImageFormatSupport, CompressedImageFormats};
use bevy::mesh::MeshPlugin;
use bevy::mesh::skinning::SkinnedMesh;
use bevy::prelude::*;
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_simpliguard::SimpliguardLods;
use bevy_simpliguard::lod::{LodGroup, LodPlugin};
use simpliguard::settings::{BakeSettings, Quality, Scope};
use simpliguard::{Context, NoResources, Source, bake};

/// The octopus, whose skin and joints are one object.
fn octopus() -> Vec<u8> {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/octopus.glb")).expect("in the repository");
    let source = Source { name: "octopus.glb", bytes: &bytes, resources: &NoResources };
    let settings = BakeSettings {
        scope: Scope::Objects,
        faces: vec![500, 1000],
        texture_size: 64.into(),
        normal_map: false,
        views: 8,
        view_size: 128,
        ..BakeSettings::preset(Quality::Draft)
    };
    let baked = bake(&source, &settings, &Context::default()).expect("bakes");
    let [object] = &baked.report.objects[..] else { panic!("one object, not {:?}", baked.report.objects) };
    assert_eq!((object.instances, object.source_faces, object.levels.len()), (1, 41_376, 2));
    baked.glb
}

fn app(glb: Vec<u8>) -> (App, Entity) {
    let (mut app, dir) = (App::new(), Dir::default());
    dir.insert_asset(Path::new("model.glb"), glb);
    app.register_asset_source(
        AssetSourceId::Default,
        AssetSourceBuilder::new(move || Box::new(MemoryAssetReader { root: dir.clone() })),
    )
    .add_plugins((
        MinimalPlugins,
        TransformPlugin,
        LodPlugin::default(),
        AssetPlugin::default(),
        ImagePlugin::default(),
        MeshPlugin,
        CameraPlugin,
        AnimationPlugin,
        WorldSerializationPlugin,
        GltfPlugin::default(),
    ))
    .insert_resource(CompressedImageFormatSupport(CompressedImageFormats::NONE));
    app.finish();
    app.cleanup();
    let scene = app.world().resource::<AssetServer>().load(GltfAssetLabel::Scene(0).from_asset("model.glb"));
    let root = app.world_mut().spawn(WorldAssetRoot(scene)).id();
    let mut groups = app.world_mut().query::<&LodGroup>();
    for _ in 0..20_000 {
        app.update();
        if groups.iter(app.world()).count() > 0 {
            app.update();
            return (app, root);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("no levels");
}

#[test]
fn a_skinned_object_keeps_its_joints_and_its_levels_hang_on_them() {
    let (mut app, root) = app(octopus());
    assert!(app.world().get::<SimpliguardLods>(root).is_none(), "the object has it, not the scene");
    let mut groups = app.world_mut().query::<(Entity, &LodGroup, &SimpliguardLods)>();
    let (entity, group, lods) = groups.single(app.world()).expect("one object");
    assert_eq!(lods.levels, group.levels);
    let levels: Vec<_> = group.levels.iter().map(|level| (level.level, level.budget)).collect();
    assert_eq!(levels, [(0, 41_376), (2, 1000), (1, 500)]);
    let joints = |level: usize| {
        let skin = app.world().get::<SkinnedMesh>(group.levels[level].primitives[0].entity);
        skin.expect("a skin").joints.clone()
    };
    assert_eq!((joints(0), joints(0).len()), (joints(1), 55));
    let transform = app.world().get::<GlobalTransform>(entity).expect("a transform");
    let center = transform.transform_point(group.center);
    // The octopus is 0.4 m high and sits on the ground.
    assert!(center.x.abs() < 0.1 && center.z.abs() < 0.1 && (0.1..0.4).contains(&center.y), "{center}");
    assert!((0.2..0.8).contains(&group.radius), "{}", group.radius);
}
