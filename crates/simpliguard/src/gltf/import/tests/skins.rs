use glam::{Mat4, Vec3, vec3};
use serde_json::json;

use super::builder::{Builder, F32, U8};
use crate::data::{Influences, Model};

/// Node 0: the triangle on skin 0. Node 1, at x = 1, and its child 2, at x = 3, are the joints, bound where they stand.
fn skinned(joints: &[[u8; 4]; 3], weights: &[[f32; 4]; 3]) -> Builder {
    let mut file = Builder::triangle();
    file.attribute("JOINTS_0", U8, "VEC4", joints);
    file.attribute("WEIGHTS_0", F32, "VEC4", weights);
    file.json["nodes"][0]["skin"] = json!(0);
    file.root(json!({"translation": [1, 0, 0], "children": [2]}));
    file.push("nodes", json!({"translation": [2, 0, 0]}));
    let bind = |x: f32| Mat4::from_translation(vec3(-x, 0.0, 0.0)).to_cols_array();
    let inverse = file.accessor(F32, "MAT4", &[bind(1.0), bind(3.0)]);
    file.push("skins", json!({"joints": [1, 2], "inverseBindMatrices": inverse}));
    file
}

/// Positions from the influences alone, as a consumer poses them.
fn unposed(model: &Model) -> Vec<Vec3> {
    let rig = model.rig.as_ref().expect("a rig");
    let pairs = model.surface.positions.iter().zip(&model.surface.influences);
    pairs.map(|(&p, influences)| rig.rest_matrix(influences).inverse().transform_point3(p)).collect()
}

#[test]
fn the_only_skin_is_kept_as_it_is() {
    let model = skinned(&[[0, 1, 0, 0]; 3], &[[0.25, 0.75, 0.0, 0.0]; 3]).model();
    let rig = model.rig.expect("a rig");
    assert_eq!(rig.source_skin, Some(0));
    assert_eq!([rig.bones[0].node, rig.bones[1].node], [1, 2]);
    assert_eq!(model.surface.influences[0], Influences { joints: [1, 0, 0, 0], weights: [0.75, 0.25, 0.0, 0.0] });
    assert_eq!(model.surface.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn vertices_follow_their_joints_and_not_their_node() {
    let mut file = skinned(&[[0, 1, 0, 0]; 3], &[[0.5, 0.5, 0.0, 0.0]; 3]);
    file.json["nodes"][0]["translation"] = json!([50, 0, 0]);
    file.json["nodes"][2]["translation"] = json!([2, 4, 0]);
    let model = file.model();
    // The second joint is 4 higher than where it was bound; half of that arrives.
    assert_eq!(model.surface.positions[0], vec3(0.0, 2.0, 0.0));
    assert_eq!(unposed(&model)[1], Vec3::X);
}

#[test]
fn the_four_heaviest_of_two_sets_are_kept_and_sum_to_one() {
    let mut file = skinned(&[[0, 1, 2, 3]; 3], &[[0.1, 0.2, 0.05, 0.4]; 3]);
    file.attribute("JOINTS_1", U8, "VEC4", &[[4u8, 0, 0, 0]; 3]);
    file.attribute("WEIGHTS_1", F32, "VEC4", &[[0.3f32, 0.0, 0.0, 0.0]; 3]);
    file.json["skins"][0] = json!({"joints": [1, 2, 3, 4, 5]});
    for _ in 3..=5 {
        file.root(json!({}));
    }
    let influences = file.model().surface.influences[0];
    assert_eq!(influences.joints, [3, 4, 1, 0]);
    assert!((influences.weights[0] - 0.4).abs() < 1e-6 && (influences.weights[3] - 0.1).abs() < 1e-6);
}

#[test]
fn weights_that_do_not_sum_to_one_are_normalised() {
    let model = skinned(&[[0, 1, 1, 0]; 3], &[[2.0, 1.0, 1.0, 0.0]; 3]).model();
    assert_eq!(model.surface.influences[0], Influences { joints: [0, 1, 0, 0], weights: [0.5, 0.5, 0.0, 0.0] });
}

#[test]
fn a_vertex_without_weight_hangs_on_the_first_joint() {
    let model = skinned(&[[1; 4]; 3], &[[0.0; 4]; 3]).model();
    assert_eq!(model.surface.influences, [Influences::rigid(0); 3]);
}

#[test]
fn weights_on_joints_past_the_skin_are_dropped_and_counted() {
    let model = skinned(&[[0, 9, 0, 0]; 3], &[[0.5, 0.5, 0.0, 0.0]; 3]).model();
    assert_eq!(model.surface.influences, [Influences::rigid(0); 3]);
    assert_eq!(model.notes, ["3 weights on joints that the skin does not have are dropped"]);
}

#[test]
fn a_mirrored_skeleton_keeps_the_outside() {
    let mut file = skinned(&[[0; 4]; 3], &[[1.0, 0.0, 0.0, 0.0]; 3]);
    file.json["nodes"][1]["scale"] = json!([1, 1, -1]);
    let surface = file.model().surface;
    assert_eq!(surface.triangles, [[0, 2, 1]]);
    assert_eq!(surface.normals[0], -Vec3::Z);
}

#[test]
fn two_skins_share_the_bones_they_have_in_common() {
    let mut file = skinned(&[[0, 1, 0, 0]; 3], &[[0.0, 1.0, 0.0, 0.0]; 3]);
    let inverse = file.json["skins"][0]["inverseBindMatrices"].clone();
    file.push("skins", json!({"joints": [2, 1]}));
    file.push("skins", json!({"joints": [1, 2], "inverseBindMatrices": inverse}));
    file.root(json!({"mesh": 0, "skin": 1}));
    file.root(json!({"mesh": 0, "skin": 2, "translation": [0, 0, 9]}));
    let model = file.model();
    let rig = model.rig.as_ref().expect("a rig");
    assert_eq!((rig.bones.len(), rig.source_skin), (4, None));
    let used: Vec<u16> = model.surface.influences.iter().map(|influences| influences.joints[0]).collect();
    // The third mesh coincides with the first in place and bones, so its face is a duplicate.
    assert_eq!(used, [1, 1, 1, 3, 3, 3]);
}

#[test]
fn an_unskinned_node_beside_a_skin_is_a_bone() {
    let mut file = skinned(&[[0; 4]; 3], &[[1.0, 0.0, 0.0, 0.0]; 3]);
    let mut plain = file.primitive().clone();
    plain["attributes"].as_object_mut().expect("an object").retain(|name, _| name == "POSITION");
    let mesh = file.push("meshes", json!({"primitives": [plain]}));
    let node = file.root(json!({"mesh": mesh, "translation": [0, 0, 9]}));
    let model = file.model();
    let rig = model.rig.as_ref().expect("a rig");
    assert_eq!((rig.bones.len(), rig.source_skin), (3, None));
    assert_eq!(rig.bones[2].node, node);
    assert_eq!(model.surface.influences[3], Influences::rigid(2));
    assert_eq!(unposed(&model)[3], model.surface.positions[3]);
}

#[test]
fn a_rigid_part_on_a_joint_moves_with_it() {
    let mut file = skinned(&[[0; 4]; 3], &[[1.0, 0.0, 0.0, 0.0]; 3]);
    let mut plain = file.primitive().clone();
    plain["attributes"].as_object_mut().expect("an object").retain(|name, _| name == "POSITION");
    let mesh = file.push("meshes", json!({"primitives": [plain]}));
    let hat = file.push("nodes", json!({"mesh": mesh, "translation": [0, 1, 0]}));
    file.json["nodes"][2]["children"] = json!([hat]);
    let times = file.accessor(F32, "SCALAR", &[0.0f32, 8.0]);
    let heights = file.accessor(F32, "VEC3", &[[2.0f32, 0.0, 0.0], [2.0, 8.0, 0.0]]);
    let channel = json!({"sampler": 0, "target": {"node": 2, "path": "translation"}});
    file.push("animations", json!({"channels": [channel], "samplers": [{"input": times, "output": heights}]}));
    let model = file.model();
    let rig = model.rig.as_ref().expect("a rig");
    assert_eq!((rig.bones.len(), rig.bones[2].node, rig.source_skin), (3, hat, None));
    assert_eq!((model.surface.influences[3], model.surface.positions[3]), (Influences::rigid(2), vec3(3.0, 1.0, 0.0)));
    assert_eq!(rig.poses[4].world[2].w_axis.truncate(), vec3(3.0, 5.0, 0.0));
}

#[test]
fn joints_of_uneven_scale_stretch_vertices_and_tilt_normals_against_it() {
    let mut file = skinned(&[[0; 4]; 3], &[[1.0, 0.0, 0.0, 0.0]; 3]);
    let slope = Vec3::new(1.0, 1.0, 0.0).normalize().to_array();
    file.attribute("NORMAL", F32, "VEC3", &[slope; 3]);
    file.json["nodes"][1]["scale"] = json!([1, 4, 1]);
    let model = file.model();
    assert_eq!(model.surface.positions[2], vec3(0.0, 4.0, 0.0));
    assert!(
        model.surface.normals[0].abs_diff_eq(vec3(4.0, 1.0, 0.0).normalize(), 1e-6),
        "{}",
        model.surface.normals[0]
    );
    assert_eq!(unposed(&model)[2], Vec3::Y);
}

#[test]
fn mesh_nodes_become_bones_once_an_animation_moves_one_of_them() {
    let mut file = Builder::triangle();
    file.json["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 1]}, {"children": [1]}]);
    file.json["scenes"][0]["nodes"] = json!([0, 2]);
    let channel = |path: &str| json!([{"channels": [{"sampler": 0, "target": {"node": 2, "path": path}}]}]);
    file.json["animations"] = channel("weights");
    assert!(file.model().rig.is_none());
    file.json["animations"] = channel("rotation");
    let model = file.model();
    let rig = model.rig.expect("a rig");
    assert_eq!(rig.bones.iter().map(|bone| bone.node).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(rig.bones[1].inverse_bind, Mat4::from_translation(-Vec3::Z));
    assert_eq!([model.surface.influences[0], model.surface.influences[3]], [0, 1].map(Influences::rigid));
    let pointer = json!({"extensions": {"KHR_animation_pointer": {"pointer": "/nodes/2/scale"}}, "path": "pointer"});
    file.json["animations"] = json!([{"channels": [{"sampler": 0, "target": pointer}]}]);
    assert!(file.model().rig.is_some());
}

#[test]
fn a_flattened_node_hangs_on_its_nearest_ancestor_that_can_be_inverted() {
    let mut file = Builder::triangle();
    file.json["nodes"] = json!([{"mesh": 0, "scale": [1, 1, 0]}, {"children": [0], "translation": [0, 3, 0]}]);
    file.json["scenes"][0]["nodes"] = json!([1]);
    file.json["animations"] = json!([{"channels": [{"sampler": 0, "target": {"node": 0, "path": "scale"}}]}]);
    let model = file.model();
    assert_eq!(model.rig.as_ref().expect("a rig").bones[0].node, 1);
    assert_eq!(model.surface.positions[0], vec3(0.0, 3.0, 0.0));
}

#[test]
fn frames_of_clips_become_poses_of_the_bones() {
    let mut file = skinned(&[[0, 1, 0, 0]; 3], &[[0.25, 0.75, 0.0, 0.0]; 3]);
    let times = file.accessor(F32, "SCALAR", &[1.0f32, 9.0]);
    let heights = file.accessor(F32, "VEC3", &[[1.0f32, 0.0, 0.0], [1.0, 8.0, 0.0]]);
    let channel = json!({"sampler": 0, "target": {"node": 1, "path": "translation"}});
    file.push("animations", json!({"channels": [channel], "samplers": [{"input": times, "output": heights}]}));
    let rig = file.model().rig.expect("a rig");
    // The joint moved, and its child with it, at eighths of the clip.
    assert_eq!((rig.poses.len(), rig.poses[3].frame), (8, Some((0, 4.0))));
    assert_eq!(rig.poses[3].world[0].w_axis.truncate(), vec3(1.0, 3.0, 0.0));
    assert_eq!(rig.poses[3].world[1].w_axis.truncate(), vec3(3.0, 3.0, 0.0));
}

#[test]
fn clips_without_channels_hold_one_pose() {
    let mut file = skinned(&[[0, 1, 0, 0]; 3], &[[0.25, 0.75, 0.0, 0.0]; 3]);
    for _ in 0..3 {
        file.push("animations", json!({}));
    }
    let rig = file.model().rig.expect("a rig");
    assert_eq!((rig.poses.len(), rig.poses[7].frame), (8, Some((0, 0.0))));
    assert!(rig.poses.iter().all(|pose| pose.world[1] == rig.bones[1].rest_world));
}

#[test]
fn a_clip_that_cannot_be_read_is_noted_and_does_no_harm() {
    let mut file = skinned(&[[0, 1, 0, 0]; 3], &[[0.25, 0.75, 0.0, 0.0]; 3]);
    let channel = json!({"sampler": 0, "target": {"node": 1, "path": "translation"}});
    file.push("animations", json!({"channels": [channel], "samplers": [{"input": 77, "output": 78}]}));
    let model = file.model();
    assert_eq!(model.rig.expect("a rig").poses, []);
    assert!(model.notes[0].starts_with("clip 0 is left out of the poses"), "{:?}", model.notes);
}

#[test]
fn a_skeleton_without_clips_is_turned_at_its_joints() {
    let rig = skinned(&[[0, 1, 0, 0]; 3], &[[0.25, 0.75, 0.0, 0.0]; 3]).model().rig.expect("a rig");
    assert_eq!(rig.poses.len(), 8);
    for pose in &rig.poses {
        assert!(pose.frame.is_none() && pose.world[0] != rig.bones[0].rest_world);
        // The first joint turns where it is, the second goes around it.
        assert_eq!(pose.world[0].w_axis.truncate(), Vec3::X);
        assert!((pose.world[1].w_axis.truncate().distance(Vec3::X) - 2.0).abs() < 1e-5);
    }
}
