//! Combined files, loaded: what the handler makes of static ones.

use bevy::asset::LoadContext;
use bevy::camera::primitives::Aabb;
use bevy::gltf::convert_coordinates::GltfConvertCoordinates;
use bevy::gltf::extensions::{ErasedGltfExtensionHandler, GltfExtensionHandler, GltfExtensionHandlers};
use bevy::gltf::{Gltf, GltfPlugin};
use bevy::prelude::*;
use bevy::tasks::block_on;
use serde_json::json;

use super::super::{LodMember, SimpliguardLods};
use super::TestApp;
use super::glb::{Glb, level};

const SOURCE_BOX: ([f32; 3], [f32; 3]) = ([-1.0; 3], [1.0; 3]);
const LEVEL_BOX: ([f32; 3], [f32; 3]) = ([1.0, 2.0, 3.0], [3.0, 4.0, 4.0]);

/// Meshes of a source and its two levels, with materials 0 and 1.
fn meshes() -> Glb {
    Glb::new().mesh(SOURCE_BOX, 7, 0).mesh(LEVEL_BOX, 2, 1).mesh(LEVEL_BOX, 1, 1)
}

/// A moved, scaled root with a mesh, and a second mesh under it; scene 1 has level 1 alone, scene 2 a part of the
/// source.
fn combined() -> Glb {
    combined_with_error(0.25)
}

/// With this error of level 1.
fn combined_with_error(error: f32) -> Glb {
    let lods = json!({ "MSFT_lod": { "ids": [2, 3] } });
    let holder =
        json!({ "mesh": 0, "children": [1], "translation": [5, 0, 0], "scale": [2, 2, 2], "extensions": lods });
    meshes()
        .set("nodes", json!([holder, { "mesh": 0 }, level(2, 1, 0.125, &[0, 1]), level(1, 2, error, &[0, 1])]))
        .set("scenes", json!([{ "nodes": [0] }, { "nodes": [3] }, { "nodes": [1] }]))
}

fn loaded(glb: Glb) -> (TestApp, Entity) {
    let mut app = TestApp::new();
    app.add_file("model.glb", glb.bytes());
    let root = app.spawn("model.glb", 0, Vec3::X * 100.0);
    (app, root)
}

fn path_of(handle: &Handle<Mesh>) -> String {
    handle.path().expect("a handle of a file").to_string()
}

#[test]
fn a_file_becomes_a_group_of_its_source_and_its_levels() {
    let (mut app, root) = loaded(combined());
    let (_, group) = app.group(root);
    let levels: Vec<_> =
        group.levels.iter().map(|l| (l.level, l.budget, l.faces, l.error, l.primitives.len())).collect();
    assert_eq!(levels, [(0, 14, 14, 0.0, 2), (2, 20, 2, 0.125, 1), (1, 10, 1, 0.25, 1)]);
    assert_eq!((group.center, group.radius), (Vec3::new(2.0, 3.0, 3.5), 1.5));
    assert_eq!(app.lods(root).levels, group.levels);
    let meshes: Vec<_> = group.levels.iter().flat_map(|l| &l.primitives).map(|p| path_of(&p.mesh)).collect();
    let expected = [0, 0, 1, 2].map(|mesh| format!("model.glb#Mesh{mesh}/Primitive0"));
    assert_eq!(meshes, expected);
}

#[test]
fn a_static_level_stands_in_the_scene_whatever_the_holder_does() {
    let (mut app, root) = loaded(combined());
    let (scene, group) = app.group(root);
    for level in &group.levels[1..] {
        let entity = app.world().entity(level.primitives[0].entity);
        assert_eq!(entity.get::<GlobalTransform>().expect("a transform").compute_transform().scale, Vec3::ONE);
        assert_eq!(entity.get::<GlobalTransform>().expect("a transform").translation(), Vec3::X * 100.0);
        assert_eq!(entity.get::<ChildOf>().map(ChildOf::parent), Some(scene));
        assert_eq!(entity.get::<LodMember>().map(|m| (m.group, m.level)), Some((scene, level.level)));
        assert_eq!(entity.get::<Name>().map(Name::as_str), Some(format!("LOD{}.0", level.level).as_str()));
        let aabb = entity.get::<Aabb>().expect("bounds");
        assert_eq!((aabb.min(), aabb.max()), (LEVEL_BOX.0.into(), LEVEL_BOX.1.into()));
    }
    let part = group.levels[0].primitives[1].entity;
    assert_eq!(app.world().get::<GlobalTransform>(part).expect("a transform").translation(), Vec3::X * 105.0);
}

#[test]
fn a_loaded_model_switches() {
    let (mut app, root) = loaded(combined());
    let camera = app.camera(Vec3::ZERO);
    for (distance, expected) in [(1.0, (0, 2)), (300.0, (2, 1)), (900.0, (1, 1))] {
        app.place(camera, Vec3::new(102.0, 3.0, 3.5 + 1.5 + distance));
        assert_eq!(app.levels_in_range(camera), [expected]);
        assert_eq!(app.lods(root).current, expected.0);
    }
}

#[test]
fn instances_share_meshes_but_not_entities() {
    let (mut app, first) = loaded(combined());
    let second = app.spawn("model.glb", 0, Vec3::ZERO);
    let (first, second) = (app.group(first).1, app.group(second).1);
    for (a, b) in first.levels.iter().zip(&second.levels) {
        for (a, b) in a.primitives.iter().zip(&b.primitives) {
            assert_eq!(a.mesh, b.mesh);
            assert_ne!(a.entity, b.entity);
            let mesh = |entity| app.app.world().get::<Mesh3d>(entity).map(|m| m.0.clone());
            assert_eq!((mesh(a.entity), mesh(b.entity)), (Some(a.mesh.clone()), Some(b.mesh.clone())));
        }
    }
}

/// Tells whether an instance of a scene has neither a group nor members.
fn is_plain(app: &mut TestApp, root: Entity) -> bool {
    let world = app.world();
    let mut members = world.query::<&LodMember>();
    members.iter(world).count() == 0 && world.get::<SimpliguardLods>(root).is_none()
}

#[test]
fn scenes_without_the_whole_source_stay_as_they_are() {
    for scene in [1, 2] {
        let mut app = TestApp::new();
        app.add_file("model.glb", combined().bytes());
        let root = app.spawn("model.glb", scene, Vec3::ZERO);
        assert!(is_plain(&mut app, root));
    }
}

#[test]
fn levels_of_another_tool_stay_as_they_are() {
    let holder = json!({ "mesh": 0, "extensions": { "MSFT_lod": { "ids": [1] } } });
    let (mut app, root) =
        loaded(meshes().set("nodes", json!([holder, { "mesh": 1 }])).set("scenes", json!([{ "nodes": [0] }])));
    assert!(is_plain(&mut app, root));
}

#[test]
fn without_a_source_the_most_detailed_level_stands_in() {
    let holder = json!({ "extensions": { "MSFT_lod": { "ids": [1, 2] } } });
    let nodes = json!([holder, level(2, 1, 0.125, &[0]), level(1, 2, 0.25, &[0])]);
    let (mut app, root) = loaded(meshes().set("nodes", nodes).set("scenes", json!([{ "nodes": [0] }])));
    let camera = app.camera(Vec3::ZERO);
    for (distance, expected) in [(1.0, (2, 1)), (300.0, (2, 1)), (900.0, (1, 1))] {
        app.place(camera, Vec3::new(102.0, 3.0, 3.5 + 1.5 + distance));
        assert_eq!(app.levels_in_range(camera), [expected]);
        assert_eq!(app.lods(root).current, expected.0);
    }
    app.lods(root).force = Some(0);
    app.app.update();
    assert_eq!(app.levels_in_range(camera), [(2, 1)]);
}

#[test]
fn a_loader_that_turns_meshes_turns_levels_too() {
    let convert = GltfConvertCoordinates { rotate_scene_entity: true, rotate_meshes: true };
    let mut app = TestApp::with(GltfPlugin { convert_coordinates: convert, ..default() }, |_| ());
    app.add_file("model.glb", combined().bytes());
    let root = app.spawn("model.glb", 0, Vec3::ZERO);
    let (scene, group) = app.group(root);
    let level = group.levels[1].primitives[0].entity;
    let aabb = app.world().get::<Aabb>(level).expect("bounds");
    assert_eq!((aabb.min(), aabb.max()), (Vec3::new(-3.0, 2.0, -4.0).into(), Vec3::new(-1.0, 4.0, -3.0).into()));
    let center = |app: &mut TestApp, entity, point: Vec3| {
        app.world().get::<GlobalTransform>(entity).expect("a transform").transform_point(point)
    };
    // The scene's half turn is left, as the one of the mesh and that of its entity cancel.
    let (from_group, from_mesh) = (center(&mut app, scene, group.center), center(&mut app, level, aabb_center()));
    assert!(from_group.distance(Vec3::new(-2.0, 3.0, -3.5)) < 1e-5, "{from_group}");
    assert!(from_mesh.distance(from_group) < 1e-5, "{from_mesh}");
}

/// Centre of the level's mesh after the loader turned it.
fn aabb_center() -> Vec3 {
    Vec3::new(-2.0, 3.0, -3.5)
}

/// Stands for a material.
#[derive(Component, Reflect, Clone, Debug, PartialEq)]
#[reflect(Component)]
struct Dress {
    material: String,
    is_level: bool,
}

#[derive(Clone)]
struct Tailor;

impl GltfExtensionHandler for Tailor {
    fn dyn_clone(&self) -> Box<dyn ErasedGltfExtensionHandler> {
        Box::new(self.clone())
    }

    fn on_spawn_mesh_and_material(
        &mut self,
        _: &mut LoadContext<'_>,
        _: &gltf::Primitive<'_>,
        _: &gltf::Mesh<'_>,
        _: &gltf::Material<'_>,
        entity: &mut EntityWorldMut<'_>,
        material: &str,
    ) {
        let is_level = entity.get::<LodMember>().is_some_and(|member| member.level > 0);
        entity.insert(Dress { material: material.to_owned(), is_level });
    }
}

#[test]
fn other_handlers_dress_levels_as_they_dress_the_source() {
    let mut app = TestApp::with(GltfPlugin::default(), |app| {
        app.register_type::<Dress>();
        block_on(app.world().resource::<GltfExtensionHandlers>().0.write()).push(Box::new(Tailor));
    });
    app.add_file("model.glb", combined().bytes());
    let root = app.spawn("model.glb", 0, Vec3::ZERO);
    for level in app.group(root).1.levels {
        let (material, is_level) = (format!("Material{}", u32::from(level.level > 0)), level.level > 0);
        for primitive in level.primitives {
            assert_eq!(
                app.world().get::<Dress>(primitive.entity),
                Some(&Dress { material: material.clone(), is_level })
            );
        }
    }
}

#[test]
fn a_reload_builds_everything_anew_and_keeps_the_settings() {
    let (mut app, root) = loaded(combined());
    // Without a file watcher, Bevy reloads only what is held as a whole.
    let file: Handle<Gltf> = app.world().resource::<AssetServer>().load("model.glb");
    // A reload before that would be taken for this load.
    app.update_until(|world| world.resource::<AssetServer>().is_loaded_with_dependencies(&file));
    let reload = |app: &mut TestApp, glb: Glb| {
        app.add_file("model.glb", glb.bytes());
        // Bevy ignores changes in the first frames after a scene is loaded.
        (0..4).for_each(|_| app.app.update());
        let old = app.world().get::<Children>(root).expect("a scene")[0];
        app.world().resource::<AssetServer>().reload("model.glb");
        app.update_until(|world| world.get_entity(old).is_err());
        app.update_until(|world| world.get::<Children>(root).is_some());
        app.app.update();
    };
    *app.lods(root) = SimpliguardLods { force: Some(1), bias: 3.0, ..app.lods(root).clone() };
    reload(&mut app, combined_with_error(0.5));
    let lods = app.lods(root).clone();
    assert_eq!((lods.force, lods.bias, lods.current), (Some(1), 3.0, 1));
    assert_eq!(lods.levels, app.group(root).1.levels);
    assert_eq!(lods.levels[2].error, 0.5);

    reload(&mut app, meshes().set("nodes", json!([{ "mesh": 0 }])).set("scenes", json!([{ "nodes": [0] }])));
    let lods = app.lods(root).clone();
    assert_eq!((lods.force, lods.current, lods.levels), (Some(1), 0, vec![]));
}
