//! Combined files with a skin: each instance's levels hang on that instance's own joints.

use bevy::camera::visibility::{DynamicSkinnedMeshBounds, NoFrustumCulling};
use bevy::gltf::{GltfPlugin, GltfSkinnedMeshBoundsPolicy};
use bevy::mesh::skinning::{SkinnedMesh, SkinnedMeshInverseBindposes};
use bevy::prelude::*;
use serde_json::json;

use super::TestApp;
use super::glb::{Glb, level};

const BOX: ([f32; 3], [f32; 3]) = ([-1.0; 3], [1.0; 3]);

/// A body on two joints, the first 4 units up in the rest pose, under a root that doubles.
fn combined() -> Glb {
    let mut lod = level(1, 1, 0.125, &[3]);
    lod["skin"] = json!(0);
    let root = json!({ "children": [1, 3], "scale": [2, 2, 2], "extensions": { "MSFT_lod": { "ids": [4] } } });
    let (joint, tip) =
        (json!({ "name": "joint", "translation": [0, 4, 0], "children": [2] }), json!({ "name": "tip" }));
    Glb::new()
        .skinned_mesh(BOX, 3, 0)
        .skinned_mesh(BOX, 1, 1)
        .set("nodes", json!([root, joint, tip, { "mesh": 0, "skin": 0 }, lod]))
        .set("skins", json!([{ "joints": [1, 2] }]))
        .set("scenes", json!([{ "nodes": [0] }]))
}

fn app(policy: GltfSkinnedMeshBoundsPolicy) -> TestApp {
    let app = TestApp::with(GltfPlugin { skinned_mesh_bounds_policy: policy, ..default() }, |_| ());
    app.add_file("model.glb", combined().bytes());
    app
}

#[test]
fn a_skinned_level_hangs_on_the_joints_of_its_own_instance() {
    let mut app = app(GltfSkinnedMeshBoundsPolicy::Dynamic);
    let roots = [Vec3::ZERO, Vec3::X * 9.0].map(|at| app.spawn("model.glb", 0, at));
    let mut all = Vec::new();
    for root in roots {
        let (scene, group) = app.group(root);
        let world = app.world();
        let skin = |level: usize| world.get::<SkinnedMesh>(group.levels[level].primitives[0].entity).expect("a skin");
        assert_eq!(skin(0).joints, skin(1).joints);
        assert_eq!(skin(0).inverse_bindposes, skin(1).inverse_bindposes);
        let names = skin(1).joints.iter().map(|&j| world.get::<Name>(j).expect("a name").as_str().to_owned());
        assert_eq!(names.collect::<Vec<_>>(), ["joint", "tip"]);
        for &joint in &skin(1).joints {
            let mut up = std::iter::successors(Some(joint), |&e| world.get::<ChildOf>(e).map(ChildOf::parent));
            assert!(up.any(|e| e == scene));
        }
        all.extend(skin(1).joints.clone());
        let binds = skin(1).inverse_bindposes.clone();
        assert_eq!(world.resource::<Assets<SkinnedMeshInverseBindposes>>().get(&binds).map(|b| b.len()), Some(2));
    }
    let distinct: std::collections::BTreeSet<Entity> = all.iter().copied().collect();
    assert_eq!(distinct.len(), 4);
}

#[test]
fn the_sphere_is_that_of_the_rest_pose() {
    let mut app = app(GltfSkinnedMeshBoundsPolicy::Dynamic);
    let root = app.spawn("model.glb", 0, Vec3::ZERO);
    let (_, group) = app.group(root);
    assert!(group.center.distance(Vec3::Y * 8.0) < 1e-5, "{}", group.center);
    assert!((group.radius - 2.0 * 3.0_f32.sqrt()).abs() < 1e-5, "{}", group.radius);
}

#[test]
fn levels_are_culled_by_the_same_policy_as_the_source() {
    use GltfSkinnedMeshBoundsPolicy::{BindPose, Dynamic, NoFrustumCulling as Never};
    for (policy, expected) in [(Dynamic, (true, false)), (Never, (false, true)), (BindPose, (false, false))] {
        let mut app = app(policy);
        let root = app.spawn("model.glb", 0, Vec3::ZERO);
        for level in app.group(root).1.levels {
            let entity = app.world().entity(level.primitives[0].entity);
            assert_eq!(
                (entity.contains::<DynamicSkinnedMeshBounds>(), entity.contains::<NoFrustumCulling>()),
                expected
            );
        }
    }
}

#[test]
fn a_level_on_joints_outside_of_the_scene_is_left_out() {
    let mut lod = level(1, 1, 0.125, &[0]);
    lod["skin"] = json!(0);
    let holder = json!({ "mesh": 0, "extensions": { "MSFT_lod": { "ids": [1, 2] } } });
    let glb = Glb::new()
        .mesh(BOX, 3, 0)
        .skinned_mesh(BOX, 1, 1)
        .mesh(BOX, 2, 1)
        .set("nodes", json!([holder, lod, level(2, 2, 0.25, &[0]), {}]))
        .set("skins", json!([{ "joints": [3] }]))
        .set("scenes", json!([{ "nodes": [0] }]));
    let mut app = TestApp::new();
    app.add_file("model.glb", glb.bytes());
    let root = app.spawn("model.glb", 0, Vec3::ZERO);
    assert_eq!(app.group(root).1.levels.iter().map(|l| l.level).collect::<Vec<_>>(), [0, 2]);
}
