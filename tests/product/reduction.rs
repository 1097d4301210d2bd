//! A level that keeps the source's materials, in a game.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use bevy::asset::io::memory::{Dir, MemoryAssetReader};
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::camera::CameraPlugin;
use bevy::gltf::{Gltf, GltfAssetLabel, GltfMaterialName, GltfPlugin};
use bevy::mesh::MeshPlugin;
use bevy::prelude::*;
use bevy::world_serialization::WorldSerializationPlugin;
use bevy_simpliguard::lod::{LodPlugin, SimpliguardLods};
use serde_json::{Value, json};
use simpliguard::settings::{BakeSettings, Quality};
use simpliguard::{Baked, Context, NoResources, Source, bake};

const MODEL: &str = "corner.glb";
/// Quads along a side of a wall.
const QUADS: u32 = 40;
const BUDGET: u32 = 1000;
/// Longest time until a model is there.
const PATIENCE: Duration = Duration::from_secs(60);

/// Keeps the file loaded.
#[derive(Resource)]
struct File(#[expect(dead_code, reason = "a handle that only has to live")] Handle<Gltf>);

/// A red wall and a blue one at a right angle, both of many flat quads.
fn corner() -> Vec<u8> {
    let (mut bin, mut views, mut accessors, mut primitives) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut push = |bytes: &[u8], accessor: Value| {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        bin.extend_from_slice(bytes);
        let mut accessor = accessor;
        accessor["bufferView"] = json!(views.len() - 1);
        accessors.push(accessor);
        accessors.len() - 1
    };
    let side = QUADS + 1;
    for (wall, across) in [Vec3::X, Vec3::Z].into_iter().enumerate() {
        let places = (0..side * side).map(|i| (across * (i % side) as f32 + Vec3::Y * (i / side) as f32).to_array());
        let positions: Vec<u8> = places.flatten().flat_map(f32::to_le_bytes).collect();
        let high = ((across + Vec3::Y) * QUADS as f32).to_array();
        let count = side * side;
        let bounds = json!({ "componentType": 5126, "type": "VEC3", "count": count, "min": [0, 0, 0], "max": high });
        let corner = |i: u32| i / QUADS * side + i % QUADS;
        let quad = |i: u32| [0, 1, side + 1, 0, side + 1, side].map(|offset| corner(i) + offset);
        let indices: Vec<u8> = (0..QUADS * QUADS).flat_map(quad).flat_map(u32::to_le_bytes).collect();
        let count = 6 * QUADS * QUADS;
        let positions = push(&positions, bounds);
        let indices = push(&indices, json!({ "componentType": 5125, "type": "SCALAR", "count": count }));
        primitives.push(json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": wall }));
    }
    let material = |name: &str, color: [f32; 4]| json!({ "name": name, "pbrMetallicRoughness": { "baseColorFactor": color }, "doubleSided": true });
    let document = json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": primitives }], "accessors": accessors, "bufferViews": views,
        "buffers": [{ "byteLength": bin.len() }],
        "materials": [material("red", [1.0, 0.1, 0.1, 1.0]), material("blue", [0.1, 0.1, 1.0, 1.0])],
    });
    let json = document.to_string();
    let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
    let (of_json, of_bin) = (json.len() as u32, bin.len() as u32);
    let header = [0x4654_6C67, 2, 28 + of_json + of_bin, of_json, 0x4E4F_534A].map(u32::to_le_bytes);
    let chunk = [of_bin, 0x004E_4942].map(u32::to_le_bytes);
    [header.as_flattened(), json.as_bytes(), chunk.as_flattened(), bin.as_slice()].concat()
}

fn baked() -> Baked {
    let bytes = corner();
    let source = Source { name: MODEL, bytes: &bytes, resources: &NoResources };
    let settings = BakeSettings {
        faces: vec![BUDGET],
        texture_size: 128.into(),
        refine_steps: 0,
        ..BakeSettings::preset(Quality::Draft)
    };
    bake(&source, &settings, &Context::default()).expect("bakes")
}

#[test]
fn a_level_with_the_materials_of_its_source_shares_them_in_a_game() {
    let baked = baked();
    let report = &baked.report.levels[0];
    assert_eq!(report.candidate, "reduction");
    assert!(report.faces <= BUDGET && report.likeness.as_ref().is_some_and(|l| l.psnr_worst > 50.0), "{report:?}");

    let mut app = game(baked.glb);
    let world = app.world_mut();
    let lods = world.query::<&SimpliguardLods>().single(world).expect("one model").clone();
    let materials = |level: u32| -> BTreeSet<String> {
        let level = lods.levels.iter().find(|l| l.level == level).expect("it is listed");
        let of = |entity: Entity| world.get::<GltfMaterialName>(entity).expect("a material").0.clone();
        level.primitives.iter().map(|primitive| of(primitive.entity)).collect()
    };
    assert_eq!(materials(1), BTreeSet::from(["blue".to_owned(), "red".to_owned()]));
    assert_eq!(materials(1), materials(0));
    let handles = world.resource::<Assets<Gltf>>().iter().next().expect("the file").1;
    assert_eq!(handles.materials.len(), 2, "no copies");
}

/// A game without a window that has loaded the model.
fn game(glb: Vec<u8>) -> App {
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
        LodPlugin::default(),
    ));
    app.finish();
    app.cleanup();
    let server = app.world().resource::<AssetServer>();
    // The file stays, so that its materials can be counted.
    let file: Handle<Gltf> = server.load(MODEL);
    let scene = server.load(GltfAssetLabel::Scene(0).from_asset(MODEL));
    app.world_mut().spawn(WorldAssetRoot(scene));
    app.insert_resource(File(file));
    let start = std::time::Instant::now();
    let is_there = |world: &mut World| {
        world.query::<&SimpliguardLods>().iter(world).any(|lods| !lods.levels.is_empty())
            && !world.resource::<Assets<Gltf>>().is_empty()
    };
    while !is_there(app.world_mut()) {
        assert!(start.elapsed() < PATIENCE, "the model has no levels");
        app.update();
        std::thread::sleep(Duration::from_millis(1));
    }
    app
}
