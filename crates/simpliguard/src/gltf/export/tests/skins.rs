//! Levels on joints.

use super::*;

#[test]
fn skinned_levels_reuse_the_skin_and_reproduce_the_rest_pose() {
    let model = two_bones(Some(0));
    let read = Read::new("skinned", &export(&model, &levels(true), &ExportParams::default()).expect("exports"));
    assert_eq!(read.json["nodes"][4]["skin"], 0);
    assert_eq!(read.json["nodes"][4]["mesh"], 1);
    // Both bones scale by two in the rest pose.
    assert_eq!(read.floats(&read.attributes(1)["POSITION"], 3), [0.0, 0.0, 0.0, 1.0, 0.25, 0.0, 0.0, 2.0, 0.0]);
    assert_eq!(read.floats(&read.attributes(1)["WEIGHTS_0"], 4)[4..8], [0.75, 0.25, 0.0, 0.0]);
    let joints = read.attributes(1)["JOINTS_0"].as_u64().expect("index") as usize;
    assert_eq!(read.json["accessors"][joints]["componentType"], 5121);
    assert_eq!(read.bytes(joints, 4), [0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
}

#[test]
fn a_skinned_levels_scene_has_its_own_joints_and_shares_mesh_and_matrices() {
    let model = two_bones(Some(0));
    let read = Read::new("alone", &export(&model, &levels(true), &ExportParams::default()).expect("exports"));
    let scene = &read.json["scenes"][1];
    assert_eq!(scene["name"], "LOD1");
    let nodes = &read.json["nodes"];
    let root = scene["nodes"][0].as_u64().expect("index") as usize;
    let alone = scene["nodes"][1].as_u64().expect("index") as usize;
    assert_eq!((&nodes[root]["name"], &nodes[root]["scale"]), (&json!("root LOD1"), &json!([2.0, 2.0, 2.0])));
    assert_eq!(nodes[alone]["mesh"], nodes[4]["mesh"]);
    let skin = &read.json["skins"][nodes[alone]["skin"].as_u64().expect("index") as usize];
    assert_eq!(skin["inverseBindMatrices"], 3);
    assert_eq!(skin["joints"], json!([root + 1, root + 2]));
    // One per level: the source's, and three copies.
    assert_eq!(read.len("skins"), 4);
    // The source's mesh node has no copy.
    assert_eq!(read.len("nodes"), 4 + 3 * 5);
}

#[test]
fn a_level_on_fewer_joints_has_a_skin_of_its_own_with_the_same_matrices() {
    let model = two_bones(Some(0));
    let mut levels = levels(true);
    levels[0].own_joints = true;
    levels[0].mesh.influences.fill(Influences::rigid(1));
    let read = Read::new("narrowed", &export(&model, &levels, &ExportParams::default()).expect("exports"));
    let skin = |node: usize| &read.json["skins"][read.json["nodes"][node]["skin"].as_u64().expect("index") as usize];
    let matrices = |skin: &Value| read.floats(&skin["inverseBindMatrices"], 16);
    let levels: Vec<usize> =
        (0..read.len("nodes")).filter(|&n| read.json["nodes"][n]["extras"].get("simpliguard").is_some()).collect();
    let [small, large] = [levels[0], levels[1]].map(skin);
    assert_eq!((&small["joints"], &large["joints"]), (&json!([2]), &json!([1, 2])));
    assert_eq!(matrices(small)[..], matrices(large)[16..]);
    let alone = export_level(&model, &Level { own_joints: true, ..level(1000, true) }).expect("exports");
    assert_eq!(Read::new("alone", &alone).json["skins"][0]["joints"], json!([1, 2]));
}

#[test]
fn a_merged_skin_has_one_joint_per_node_and_binds_in_the_world() {
    let mut model = two_bones(None);
    let rig = model.rig.as_mut().expect("rig");
    // The same joint, bound in other units.
    let double = Bone { inverse_bind: Mat4::from_scale(Vec3::splat(3.0)), ..rig.bones[0] };
    rig.bones.push(double);
    let mut level = level(1000, true);
    level.mesh.influences[0] = Influences { joints: [2, 0, 0, 0], weights: [0.5, 0.5, 0.0, 0.0] };
    let read = Read::new("merged", &export(&model, &[level], &ExportParams::default()).expect("exports"));
    assert_eq!(read.json["skins"][1]["joints"], json!([1, 2]));
    assert_eq!(read.floats(&read.attributes(1)["WEIGHTS_0"], 4)[..4], [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(read.floats(&read.attributes(1)["POSITION"], 3)[3..6], [2.0, 0.5, 0.0]);
    let matrices = read.floats(&read.json["skins"][1]["inverseBindMatrices"], 16);
    assert_eq!((matrices[0], matrices[16], matrices[16 + 13]), (0.5, 0.5, -1.0));
}

#[test]
fn a_merged_skin_over_several_roots_gets_a_common_one() {
    let mut model = two_bones(None);
    model.document.json["nodes"][1]["children"] = json!([]);
    model.document.json["nodes"][1].as_object_mut().expect("object").remove("children");
    model.document.json["scenes"][0]["nodes"] = json!([0, 3, 2]);
    let read = Read::new("joined", &export(&model, &levels(true), &ExportParams::default()).expect("exports"));
    assert_eq!(read.json["scenes"][0]["nodes"], json!([4]));
    assert_eq!(read.json["nodes"][4]["children"], json!([0, 3, 2]));
    assert_eq!(read.json["nodes"][4]["extensions"]["MSFT_lod"]["ids"].as_array().map(Vec::len), Some(3));
    Read::new("joined_level", &export_level(&model, &level(1000, true)).expect("exports"));
}

#[test]
fn more_joints_than_engines_take_are_refused_by_number() {
    let mut model = two_bones(None);
    let rig = model.rig.as_mut().expect("rig");
    rig.bones = (0..300).map(|node| Bone { node, ..rig.bones[0] }).collect();
    let mut level = level(1000, true);
    let bones = |first: u16| Influences { joints: [first, first + 1, first + 2, first + 3], weights: [0.25; 4] };
    level.mesh.influences = (0..75).map(|v| bones(4 * v)).collect();
    level.mesh.positions = vec![Vec3::ZERO; 75];
    level.mesh.normals = vec![Vec3::Z; 75];
    level.mesh.uvs = vec![Vec2::ZERO; 75];
    let message = export(&model, &[level], &ExportParams::default()).expect_err("refused").to_string();
    assert!(message.contains("300 joints"), "{message}");
}

#[test]
fn a_collapsed_joint_still_has_finite_vertices() {
    let mut model = two_bones(Some(0));
    model.rig.as_mut().expect("rig").bones[0].rest_world = Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0));
    let read = Read::new("collapsed", &export(&model, &levels(true), &ExportParams::default()).expect("exports"));
    assert!(read.floats(&read.attributes(1)["POSITION"], 3).iter().all(|x| x.is_finite()));
}

#[test]
fn a_skinned_level_alone_has_skeleton_skin_and_every_clip_in_order() {
    let read = Read::new("level_skinned", &export_level(&two_bones(Some(0)), &level(1000, true)).expect("exports"));
    assert_eq!(read.json["scenes"], json!([{ "name": "main", "nodes": [0, 3] }]));
    let nodes = &read.json["nodes"];
    assert_eq!([&nodes[0]["name"], &nodes[1]["name"], &nodes[2]["name"]], ["root", "upper", "lower"]);
    assert_eq!((&nodes[3]["mesh"], &nodes[3]["skin"]), (&json!(0), &json!(0)));
    assert_eq!(read.json["skins"][0]["joints"], json!([1, 2]));
    assert_eq!([&read.json["animations"][0]["name"], &read.json["animations"][1]["name"]], ["turn", "morph"]);
    assert_eq!((read.len("nodes"), read.len("meshes"), read.len("skins")), (4, 1, 1));
}
