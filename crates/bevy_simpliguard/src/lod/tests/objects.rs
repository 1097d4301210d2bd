//! Scenes with levels for each object.

use std::sync::{Arc, Mutex};

use bevy::asset::LoadContext;
use bevy::camera::visibility::VisibilityRange;
use bevy::gltf::extensions::{ErasedGltfExtensionHandler, GltfExtensionHandler, GltfExtensionHandlers};
use bevy::gltf::{Gltf, GltfMaterial, GltfPlugin};
use bevy::prelude::*;
use bevy::tasks::block_on;
use serde_json::{Value, json};

use super::super::{LodGroup, LodMember, LodSettings, SimpliguardLods};
use super::TestApp;
use super::glb::{Glb, level};

const BOX: ([f32; 3], [f32; 3]) = ([-1.0; 3], [1.0; 3]);

/// A level of the object at a node.
fn object_level(number: u32, mesh: usize, error: f32, object: usize) -> Value {
    let mut node = level(number, mesh, error, &[object]);
    node["extras"]["simpliguard"]["object"] = json!(object);
    node["extras"]["simpliguard"]["space"] = json!(object);
    node
}

/// Three houses of one mesh, 1000 units from each other: as it is, mirrored, and three times as large; a stone of its own
/// below the first.
fn village() -> Glb {
    let house = |mut node: Value| {
        node["mesh"] = json!(0);
        node
    };
    let mut nodes = vec![
        house(json!({ "name": "first", "children": [3] })),
        house(json!({ "name": "mirrored", "translation": [1000, 0, 0], "scale": [-1, 1, 1] })),
        house(json!({ "name": "large", "translation": [2000, 0, 0], "scale": [3, 3, 3] })),
        json!({ "name": "stone", "mesh": 3 }),
    ];
    for object in 0..3 {
        nodes.extend([object_level(2, 1, 0.01, object), object_level(1, 2, 0.02, object)]);
    }
    Glb::new()
        .mesh(BOX, 9, 0)
        .mesh(BOX, 4, 1)
        .mesh(BOX, 2, 1)
        .mesh(BOX, 1, 0)
        .set("nodes", json!(nodes))
        .set("scenes", json!([{ "nodes": [0, 1, 2] }]))
}

fn loaded() -> (TestApp, Entity) {
    let mut app = TestApp::new();
    app.add_file("village.glb", village().bytes());
    let root = app.spawn("village.glb", 0, Vec3::ZERO);
    (app, root)
}

/// The entity of a node.
fn named(app: &mut TestApp, name: &str) -> Entity {
    let mut names = app.world().query::<(Entity, &Name)>();
    let found = names.iter(app.app.world()).find(|(_, found)| found.as_str() == name);
    found.expect("a node of that name").0
}

fn current(app: &mut TestApp) -> [u32; 3] {
    ["first", "mirrored", "large"].map(|name| {
        let entity = named(app, name);
        app.lods(entity).current
    })
}

#[test]
fn each_object_switches_by_its_own_distance_and_size() {
    let (mut app, root) = loaded();
    assert!(app.world().get::<SimpliguardLods>(root).is_none());
    let camera = app.camera(Vec3::ZERO);
    app.world().resource_mut::<LodSettings>().fade = 0.0;
    // The diagonal is 3.46 units; its hundredth is a pixel at a distance of 17.3 units, its fiftieth at 34.6.
    for (x, expected) in [(0.0, [0, 1, 1]), (25.0, [2, 1, 1]), (500.0, [1, 1, 1]), (1925.0, [1, 1, 2])] {
        app.place(camera, Vec3::X * x);
        assert_eq!(current(&mut app), expected, "at {x}");
    }
    app.place(camera, Vec3::X * 1000.0);
    assert_eq!(current(&mut app), [1, 0, 1]);
}

#[test]
fn levels_hang_below_their_object_and_share_its_meshes() {
    let (mut app, _) = loaded();
    let groups = ["first", "mirrored", "large"].map(|name| {
        let entity = named(&mut app, name);
        (entity, app.world().get::<LodGroup>(entity).expect("levels").clone())
    });
    let first = &groups[0].1;
    for (entity, group) in &groups {
        assert_eq!((group.center, group.radius), (Vec3::ZERO, 3.0_f32.sqrt()));
        let levels: Vec<_> =
            group.levels.iter().map(|level| (level.level, level.faces, level.primitives.len())).collect();
        assert_eq!(levels, [(0, 9, 1), (2, 2, 1), (1, 1, 1)], "the stone below the first house is not part of it");
        for (level, other) in group.levels.iter().zip(&first.levels) {
            assert_eq!(level.primitives[0].mesh, other.primitives[0].mesh);
            let part = app.world().entity(level.primitives[0].entity);
            assert_eq!(part.get::<ChildOf>().map(ChildOf::parent), Some(*entity));
            assert_eq!(part.get::<LodMember>().map(|member| member.group), Some(*entity));
        }
    }
}

/// The village, and beyond it a level that stands for all its houses and the stone.
fn village_with_whole() -> (TestApp, Entity) {
    let mut nodes = village().json["nodes"].as_array().expect("nodes").clone();
    let mut whole = level(1, 4, 0.02, &[0, 1, 2, 3]);
    whole["extras"]["simpliguard"]["whole"] = json!(true);
    whole["name"] = json!("whole");
    nodes.push(whole);
    let mut app = TestApp::new();
    let file = village().mesh(([-3.0, -3.0, -3.0], [2003.0, 3.0, 3.0]), 1, 0).set("nodes", json!(nodes));
    app.add_file("village.glb", file.bytes());
    let root = app.spawn("village.glb", 0, Vec3::ZERO);
    (app, root)
}

/// What is seen of the mesh of a node: nothing, a part, or everything.
fn shown(app: &mut TestApp, name: &str) -> &'static str {
    let entity = named(app, name);
    let mesh = app.world().get::<Children>(entity).map(|children| children[0]).unwrap_or(entity);
    let range = app.world().get::<VisibilityRange>(mesh).expect("is in a group");
    let is_part = range.start_margin.end > 0.0 || range.end_margin.start < 0.0;
    if range.is_culled(1.0) {
        "nothing"
    } else if is_part {
        "a part"
    } else {
        "everything"
    }
}

#[test]
fn one_level_stands_for_all_objects_from_afar() {
    let (mut app, root) = village_with_whole();
    let camera = app.camera(Vec3::ZERO);
    let seen = |app: &mut TestApp| {
        let houses = ["first", "mirrored", "large"].map(|name| {
            let entity = named(app, name);
            let group = app.world().get::<LodGroup>(entity).expect("levels").clone();
            let parts = group.levels.iter().flat_map(|level| &level.primitives);
            parts.filter(|p| !app.world().get::<VisibilityRange>(p.entity).expect("a range").is_culled(1.0)).count()
        });
        let [stone, whole] = ["stone", "whole.0"].map(|name| shown(app, name));
        (houses, stone, whole, app.lods(root).current)
    };
    app.place(camera, Vec3::ZERO);
    assert_eq!(seen(&mut app), ([1, 1, 1], "everything", "nothing", 0));
    // The diagonal is 2,006 units; its fiftieth is a pixel from 20,000 units on, where the fade begins.
    app.place(camera, Vec3::Y * 22_050.0);
    let (houses, stone, whole, _) = seen(&mut app);
    assert_eq!((houses, stone, whole), ([1, 1, 1], "a part", "a part"));
    app.place(camera, Vec3::Y * 40_000.0);
    assert_eq!(seen(&mut app), ([0, 0, 0], "nothing", "everything", 1));
    // A part that is hidden is missing in no level of its own.
    let first = named(&mut app, "first");
    app.world().entity_mut(first).insert(Visibility::Hidden);
    app.place(camera, Vec3::Y * 40_000.0);
    assert_eq!(seen(&mut app), ([1, 1, 1], "everything", "nothing", 0));
    app.world().entity_mut(first).insert(Visibility::Inherited);
    app.place(camera, Vec3::Y * 40_000.0);
    assert_eq!(seen(&mut app).3, 1);
    // A level that is forced is one of the objects.
    app.world().get_mut::<SimpliguardLods>(root).expect("levels").force = Some(1);
    app.place(camera, Vec3::Y * 40_000.0);
    assert_eq!(seen(&mut app), ([1, 1, 1], "everything", "nothing", 0));
    assert_eq!(current(&mut app), [1, 1, 1]);
}

#[test]
fn a_hidden_object_is_hidden_at_every_level() {
    let (mut app, _) = loaded();
    let camera = app.camera(Vec3::ZERO);
    let object = named(&mut app, "large");
    app.world().entity_mut(object).insert(Visibility::Hidden);
    app.place(camera, Vec3::ZERO);
    let group = app.world().get::<LodGroup>(object).expect("levels").clone();
    for part in group.levels.iter().flat_map(|level| &level.primitives) {
        assert!(!app.world().get::<InheritedVisibility>(part.entity).expect("visibility").get());
    }
    let other = named(&mut app, "first");
    let part = app.world().get::<LodGroup>(other).expect("levels").levels[0].primitives[0].entity;
    assert!(app.world().get::<InheritedVisibility>(part).expect("visibility").get());
}

#[test]
fn the_instance_of_a_scene_sets_what_its_objects_do_not() {
    let (mut app, root) = loaded();
    app.camera(Vec3::X * 5000.0);
    app.app.update();
    assert_eq!(current(&mut app), [1, 1, 1]);
    app.world().entity_mut(root).insert(SimpliguardLods { force: Some(2), ..default() });
    let first = named(&mut app, "first");
    app.lods(first).force = Some(0);
    app.app.update();
    assert_eq!(current(&mut app), [0, 2, 2]);
    app.world().entity_mut(root).insert(SimpliguardLods { enabled: false, ..default() });
    app.app.update();
    assert_eq!(current(&mut app), [0, 0, 0]);
}

#[test]
fn a_reload_keeps_what_is_set_on_objects() {
    let (mut app, root) = loaded();
    // Without a file watcher, Bevy reloads only what is held as a whole.
    let file: Handle<Gltf> = app.world().resource::<AssetServer>().load("village.glb");
    app.update_until(|world| world.resource::<AssetServer>().is_loaded_with_dependencies(&file));
    let [first, large] = ["first", "large"].map(|name| named(&mut app, name));
    app.world().entity_mut(first).insert(Visibility::Hidden);
    *app.lods(large) = SimpliguardLods { force: Some(2), bias: 3.0, ..app.lods(large).clone() };
    // In the new file, a house has moved, and another one stands before it.
    let mut nodes = village().json["nodes"].as_array().expect("nodes").clone();
    nodes[1]["translation"] = json!([1000, 0, 50]);
    nodes.push(json!({ "name": "new", "mesh": 0 }));
    let added = nodes.len() - 1;
    let scenes = json!([{ "nodes": [added, 0, 1, 2] }]);
    app.add_file("village.glb", village().set("nodes", json!(nodes)).set("scenes", scenes).bytes());
    // Bevy ignores changes in the first frames after a scene is loaded.
    (0..4).for_each(|_| app.app.update());
    app.world().resource::<AssetServer>().reload("village.glb");
    app.update_until(|world| world.get_entity(first).is_err());
    app.update_until(|world| world.get::<Children>(root).is_some());
    app.app.update();
    let set = ["first", "mirrored", "large"].map(|name| {
        let entity = named(&mut app, name);
        let visibility = *app.world().get::<Visibility>(entity).expect("visibility");
        let lods = app.lods(entity);
        (lods.force, lods.bias, lods.levels.len(), visibility)
    });
    let fresh = (None, 1.0, 3, Visibility::Inherited);
    assert_eq!(set, [(None, 1.0, 3, Visibility::Hidden), fresh, (Some(2), 3.0, 3, Visibility::Inherited)]);
}

#[test]
fn a_scene_without_sources_shows_the_most_detailed_levels() {
    let mut app = TestApp::new();
    let nodes = json!([{ "name": "a" }, object_level(2, 1, 0.01, 0), object_level(1, 2, 0.02, 0)]);
    app.add_file("village.glb", village().set("nodes", nodes).set("scenes", json!([{ "nodes": [0] }])).bytes());
    app.spawn("village.glb", 0, Vec3::ZERO);
    app.camera(Vec3::ZERO);
    app.app.update();
    let object = named(&mut app, "a");
    assert_eq!(app.lods(object).current, 2);
}

/// Notes the materials that are made, with whether they cull, and those that entities get.
#[derive(Clone, Default)]
struct Painter {
    made: Arc<Mutex<Vec<(String, bool)>>>,
    used: Arc<Mutex<Vec<String>>>,
}

impl GltfExtensionHandler for Painter {
    fn dyn_clone(&self) -> Box<dyn ErasedGltfExtensionHandler> {
        Box::new(self.clone())
    }

    fn on_material(
        &mut self,
        _: &mut LoadContext<'_>,
        _: &gltf::Material<'_>,
        _: Handle<GltfMaterial>,
        asset: &GltfMaterial,
        label: &str,
    ) {
        self.made.lock().expect("not poisoned").push((label.to_owned(), asset.cull_mode.is_some()));
    }

    fn on_spawn_mesh_and_material(
        &mut self,
        _: &mut LoadContext<'_>,
        _: &gltf::Primitive<'_>,
        _: &gltf::Mesh<'_>,
        _: &gltf::Material<'_>,
        _: &mut EntityWorldMut<'_>,
        label: &str,
    ) {
        self.used.lock().expect("not poisoned").push(label.to_owned());
    }
}

#[test]
fn mirrored_levels_have_a_material_that_shows_both_sides() {
    let painter = Painter::default();
    let handler = painter.clone();
    let mut app = TestApp::with(GltfPlugin::default(), |app| {
        block_on(app.world().resource::<GltfExtensionHandlers>().0.write()).push(Box::new(handler));
    });
    app.add_file("village.glb", village().bytes());
    app.spawn("village.glb", 0, Vec3::ZERO);
    let (made, used) = (painter.made.lock().expect("not poisoned"), painter.used.lock().expect("not poisoned"));
    let of = |label: &str| made.iter().filter(|(made, _)| made == label).map(|(_, culls)| *culls).collect::<Vec<_>>();
    assert_eq!((of("Material1"), of("Material1 (inverted)")), (vec![true], vec![false]), "{made:?}");
    let count = |label: &str| used.iter().filter(|used| *used == label).count();
    assert_eq!((count("Material1"), count("Material1 (inverted)")), (4, 2), "{used:?}");
}
