//! Combined files with morph targets: each instance's levels morph with that instance's source.

use bevy::mesh::morph::{MeshMorphWeights, MorphWeights};
use bevy::prelude::*;
use serde_json::json;

use super::TestApp;
use super::glb::{Glb, level};

const BOX: ([f32; 3], [f32; 3]) = ([-1.0; 3], [1.0; 3]);
const MOVES: [[f32; 3]; 2] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A stand without targets and a face with two, whose one level has both; `stand` and `face` are the meshes of their
/// nodes.
fn combined(stand: Option<usize>, face: Option<usize>) -> Glb {
    let node = |name: &str, mesh: Option<usize>| match mesh {
        Some(mesh) => json!({ "name": name, "mesh": mesh }),
        None => json!({ "name": name }),
    };
    let root = json!({ "children": [1, 2], "extensions": { "MSFT_lod": { "ids": [3] } } });
    Glb::new()
        .mesh(BOX, 1, 0)
        .morphing_mesh(BOX, 3, 0, &MOVES)
        .morphing_mesh(BOX, 1, 1, &MOVES)
        .set("nodes", json!([root, node("stand", stand), node("face", face), level(1, 2, 0.125, &[1, 2])]))
        .set("scenes", json!([{ "nodes": [0] }]))
}

/// The entity whose weights a mesh entity follows.
fn driver(world: &World, entity: Entity) -> Option<Entity> {
    match world.get::<MeshMorphWeights>(entity) {
        Some(MeshMorphWeights::Reference(driver)) => Some(*driver),
        _ => None,
    }
}

#[test]
fn a_level_morphs_with_the_source_of_its_own_instance() {
    let mut app = TestApp::new();
    app.add_file("model.glb", combined(Some(0), Some(1)).bytes());
    let roots = [Vec3::ZERO, Vec3::X * 9.0].map(|at| app.spawn("model.glb", 0, at));
    let mut drivers = Vec::new();
    for root in roots {
        let (scene, group) = app.group(root);
        let world = app.world();
        let [source, level] = &group.levels[..] else { panic!("a source and a level: {:?}", group.levels) };
        let face = driver(world, level.primitives[0].entity).expect("a reference");
        assert_eq!(world.get::<Name>(face).map(Name::as_str), Some("face"));
        assert_eq!(world.get::<MorphWeights>(face).map(MorphWeights::weights), Some(&[0.25, 0.25][..]));
        let of_source: Vec<Option<Entity>> = source.primitives.iter().map(|p| driver(world, p.entity)).collect();
        assert_eq!(of_source, [None, Some(face)]);
        let mut up = std::iter::successors(Some(face), |&e| world.get::<ChildOf>(e).map(ChildOf::parent));
        assert!(up.any(|entity| entity == scene));
        drivers.push(face);
    }
    assert_ne!(drivers[0], drivers[1]);
}

#[test]
fn a_level_without_its_source_keeps_the_default_weights() {
    let mut app = TestApp::new();
    app.add_file("model.glb", combined(None, None).bytes());
    let root = app.spawn("model.glb", 0, Vec3::ZERO);
    let (_, group) = app.group(root);
    let entity = group.levels[0].primitives[0].entity;
    let weights = app.world().get::<MeshMorphWeights>(entity);
    assert!(matches!(weights, Some(MeshMorphWeights::Value { weights }) if *weights == [0.25, 0.25]), "{weights:?}");
}
