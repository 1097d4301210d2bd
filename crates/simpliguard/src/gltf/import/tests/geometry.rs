use glam::{Vec2, Vec3, Vec4, vec3};
use serde_json::json;

use super::builder::{Builder, F32, I16, U8, U16, U32};
use crate::data::{MorphTarget, Morphs};

fn positions(builder: &Builder) -> Vec<Vec3> {
    builder.model().surface.positions
}

#[test]
fn nested_nodes_place_a_mesh_in_the_world() {
    let mut file = Builder::triangle();
    file.json["nodes"] = json!([
        {"mesh": 0, "translation": [1, 0, 0]},
        {"children": [0], "scale": [2, 2, 2], "translation": [0, 0, 5]},
    ]);
    file.json["scenes"][0]["nodes"] = json!([1]);
    assert_eq!(positions(&file), [vec3(2.0, 0.0, 5.0), vec3(4.0, 0.0, 5.0), vec3(2.0, 2.0, 5.0)]);
    let document = file.model().document;
    assert_eq!(document.mesh_nodes, [0]);
    assert_eq!(document.node_world[0].transform_point3(Vec3::ZERO), vec3(2.0, 0.0, 5.0));
}

#[test]
fn a_mesh_of_two_nodes_is_there_twice() {
    let mut file = Builder::triangle();
    file.root(json!({"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 7, 1]}));
    let surface = file.model().surface;
    assert_eq!(surface.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(surface.positions[3], vec3(0.0, 0.0, 7.0));
}

#[test]
fn a_mirrored_node_turns_its_faces_and_keeps_the_outside() {
    let mut file = Builder::triangle();
    file.attribute("NORMAL", F32, "VEC3", &[[0.0f32, 0.0, 1.0]; 3]);
    file.attribute("TANGENT", F32, "VEC4", &[[1.0f32, 0.0, 0.0, 1.0]; 3]);
    file.json["nodes"][0]["scale"] = json!([1, 1, -1]);
    let surface = file.model().surface;
    assert_eq!(surface.triangles, [[0, 2, 1]]);
    assert_eq!(surface.normals, [vec3(0.0, 0.0, -1.0); 3]);
    assert_eq!(surface.tangents, [Vec4::new(1.0, 0.0, 0.0, -1.0); 3]);
}

#[test]
fn the_front_of_a_mirrored_double_sided_mesh_is_where_its_normals_point() {
    for (double_sided, normal, expected) in
        [(true, -1.0f32, [0, 1, 2]), (true, 1.0, [0, 2, 1]), (false, -1.0, [0, 2, 1])]
    {
        let mut file = Builder::triangle();
        file.attribute("NORMAL", F32, "VEC3", &[[0.0, 0.0, normal]; 3]);
        file.json["materials"] = json!([{"doubleSided": double_sided}]);
        file.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        file.json["nodes"][0]["scale"] = json!([1, 1, -1]);
        assert_eq!(file.model().surface.triangles, [expected], "{double_sided}, {normal}");
    }
}

#[test]
fn uneven_scale_tilts_normals_by_the_inverse_transpose() {
    let mut file = Builder::triangle();
    file.attribute("NORMAL", F32, "VEC3", &[[1.0f32, 1.0, 0.0]; 3]);
    file.json["nodes"][0]["scale"] = json!([1, 2, 1]);
    let expected = vec3(2.0, 1.0, 0.0).normalize();
    assert!(file.model().surface.normals.iter().all(|n| n.abs_diff_eq(expected, 1e-6)));
}

#[test]
fn strips_and_fans_become_triangles_of_one_direction() {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    for (mode, indices, expected) in
        [(5, [0u16, 1, 2, 3], [[0, 1, 2], [1, 3, 2]]), (6, [0u16, 1, 3, 2], [[1, 3, 0], [3, 2, 0]])]
    {
        let mut file = Builder::new();
        let position = file.accessor(F32, "VEC3", &corners);
        let indices = file.accessor(U16, "SCALAR", &indices);
        let primitive = json!({"attributes": {"POSITION": position}, "indices": indices, "mode": mode});
        file.push("meshes", json!({"primitives": [primitive]}));
        file.root(json!({"mesh": 0}));
        let surface = file.model().surface;
        let by_corner = |t: [u32; 3]| {
            t.map(|v| corners.iter().position(|&c| Vec3::from(c) == surface.positions[v as usize]).expect("a corner"))
        };
        assert_eq!(surface.triangles.iter().map(|&t| by_corner(t)).collect::<Vec<_>>(), expected);
    }
}

#[test]
fn only_referenced_vertices_are_kept() {
    let mut file = Builder::triangle();
    file.attribute(
        "POSITION",
        F32,
        "VEC3",
        &[[9.0f32; 3], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [8.0; 3], [0.0, 1.0, 0.0]],
    );
    let indices = file.accessor(U8, "SCALAR", &[1u8, 2, 4]);
    file.primitive()["indices"] = json!(indices);
    assert_eq!(positions(&file), [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn sparse_elements_replace_those_of_the_view_or_zeros() {
    let mut file = Builder::triangle();
    let at = file.view(&[1, 0, 2, 0]);
    let values = file.view(bytemuck::cast_slice(&[[3.0f32, 0.0, 0.0], [0.0, 4.0, 0.0]]));
    let sparse = json!({
        "count": 2,
        "indices": {"bufferView": at, "componentType": U16},
        "values": {"bufferView": values},
    });
    file.json["accessors"][0]["sparse"] = sparse;
    assert_eq!(positions(&file), [Vec3::ZERO, vec3(3.0, 0.0, 0.0), vec3(0.0, 4.0, 0.0)]);
    file.json["accessors"][0].as_object_mut().expect("an object").remove("bufferView");
    assert_eq!(positions(&file), [Vec3::ZERO, vec3(3.0, 0.0, 0.0), vec3(0.0, 4.0, 0.0)]);
}

#[test]
fn interleaved_quantized_positions_are_scaled() {
    let mut file = Builder::triangle();
    let vertices = [[0i16, 0, 0, 1], [32767, 0, 0, 2], [0, -32767, 0, 3]];
    let view = file.view(bytemuck::cast_slice(&vertices));
    file.json["bufferViews"][view]["byteStride"] = json!(8);
    let accessor = json!({
        "bufferView": view, "componentType": I16, "normalized": true, "count": 3, "type": "VEC3",
    });
    let accessor = file.push("accessors", accessor);
    file.primitive()["attributes"]["POSITION"] = json!(accessor);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    assert_eq!(positions(&file), [Vec3::ZERO, Vec3::X, -Vec3::Y]);
}

#[test]
fn gpu_instances_are_placed_one_by_one() {
    let mut file = Builder::triangle();
    let translation = file.accessor(F32, "VEC3", &[[0.0f32, 0.0, 0.0], [5.0, 0.0, 0.0]]);
    let scale = file.accessor(F32, "VEC3", &[[1.0f32; 3], [2.0; 3]]);
    let attributes = json!({"TRANSLATION": translation, "SCALE": scale});
    file.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    let surface = file.model().surface;
    assert_eq!(surface.triangles.len(), 2);
    assert_eq!(surface.positions[4], vec3(7.0, 0.0, 0.0));
}

#[test]
fn default_morph_weights_move_the_vertices_and_the_node_has_the_last_word() {
    let mut file = Builder::triangle();
    let offsets = file.accessor(F32, "VEC3", &[[0.0f32, 0.0, 2.0]; 3]);
    file.primitive()["targets"] = json!([{"POSITION": offsets}]);
    file.json["meshes"][0]["weights"] = json!([0.5]);
    assert_eq!(positions(&file)[1], vec3(1.0, 0.0, 1.0));
    file.json["nodes"][0]["weights"] = json!([1]);
    assert_eq!(positions(&file)[1], vec3(1.0, 0.0, 2.0));
}

#[test]
fn morph_targets_are_kept_in_world_space_for_the_vertices_they_move() {
    let mut file = Builder::triangle();
    let offsets = file.accessor(F32, "VEC3", &[[0.0f32, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 0.0]]);
    file.primitive()["targets"] = json!([{"POSITION": offsets}]);
    file.json["meshes"][0]["extras"] = json!({"targetNames": ["lift"]});
    file.json["nodes"][0]["scale"] = json!([1, 1, 3]);
    let morphs = file.model().surface.morphs.expect("targets");
    let expected = MorphTarget { name: "lift".into(), weight: 0.0, displacements: vec![(1, vec3(0.0, 0.0, 6.0))] };
    assert_eq!(morphs, Morphs { node: 0, targets: vec![expected] });
}

#[test]
fn targets_of_one_face_go_together_and_others_are_left_out_by_name() {
    let mut file = Builder::triangle();
    let offsets = file.accessor(F32, "VEC3", &[[0.0f32, 0.0, 1.0]; 3]);
    file.primitive()["targets"] = json!([{"POSITION": offsets}]);
    file.json["meshes"][0]["extras"] = json!({"targetNames": ["smile"]});
    let mut other = file.json["meshes"][0].clone();
    file.push("meshes", other.clone());
    other["extras"]["targetNames"] = json!(["tail"]);
    file.push("meshes", other);
    file.root(json!({"mesh": 1, "translation": [0, 9, 0]}));
    file.root(json!({"mesh": 2, "translation": [0, 0, 9]}));
    let model = file.model();
    let moves = &model.surface.morphs.as_ref().expect("targets").targets[0].displacements;
    assert_eq!(moves.iter().map(|(v, _)| *v).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
    assert_eq!(model.notes.len(), 1);
    assert!(model.notes[0].starts_with("1 morph targets of node 2 stay"), "{:?}", model.notes);
}

#[test]
fn without_normals_faces_are_flat() {
    let mut file = Builder::triangle();
    // Two faces at a right angle along x.
    let corners =
        [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 0.0]];
    file.attribute("POSITION", F32, "VEC3", &corners);
    assert_eq!(file.model().surface.normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::Y, Vec3::Y, Vec3::Y]);
}

#[test]
fn a_file_without_one_usable_position_is_refused() {
    for (far, reason) in [(f32::NAN, "1 have corners that are not finite"), (1e30, "1 have corners over 1e9")] {
        let mut file = Builder::triangle();
        file.attribute("POSITION", F32, "VEC3", &[[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, far, 0.0]]);
        let message = file.message();
        assert!(message.contains("none of its 1 faces can be used") && message.contains(reason), "{message}");
    }
}

#[test]
fn tiny_faces_have_an_area_too() {
    let mut file = Builder::triangle();
    file.attribute("POSITION", F32, "VEC3", &[[0.0f32, 0.0, 0.0], [1e-30, 0.0, 0.0], [0.0, 1e-30, 0.0]]);
    assert_eq!(file.model().surface.triangles.len(), 1);
}

#[test]
fn unusable_faces_are_dropped_and_counted() {
    let mut file = Builder::triangle();
    let corners =
        [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0], [0.0, 0.0, -0.0]];
    file.attribute("POSITION", F32, "VEC3", &corners);
    let faces = [[0u32, 1, 2], [1, 2, 5], [2, 1, 0], [0, 1, 3], [0, 0, 1], [0, 1, 4]];
    let indices = file.accessor(U32, "SCALAR", bytemuck::cast_slice::<_, u32>(&faces));
    file.primitive()["indices"] = json!(indices);
    let model = file.model();
    // The third is the first seen from behind, and stays.
    let corners = |t: usize| model.surface.triangles[t].map(|v| model.surface.positions[v as usize]);
    assert_eq!(model.surface.triangles.len(), 2);
    assert_eq!((corners(0), corners(1)), ([Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::Y, Vec3::X, Vec3::ZERO]));
    assert_eq!(
        model.notes,
        [
            "1 faces with corners that are not finite are dropped",
            "2 degenerate faces are dropped",
            "1 duplicate faces are dropped",
        ]
    );
}

#[test]
fn equal_faces_of_two_materials_both_stay() {
    let mut file = Builder::triangle();
    let (a, b) = (file.push("materials", json!({"name": "a"})), file.push("materials", json!({"name": "b"})));
    let first = file.primitive().clone();
    file.json["meshes"][0]["primitives"] = json!([first.clone(), first]);
    file.json["meshes"][0]["primitives"][0]["material"] = json!(b);
    file.json["meshes"][0]["primitives"][1]["material"] = json!(a);
    let model = file.model();
    assert_eq!(model.surface.material, [1, 0]);
    assert_eq!([&*model.materials[0].name, &*model.materials[1].name], ["a", "b"]);
}

#[test]
fn attributes_missing_in_one_primitive_get_their_defaults() {
    let mut file = Builder::triangle();
    let plain = file.primitive().clone();
    file.attribute("COLOR_0", U8, "VEC4", &[[255u8, 0, 51, 255]; 3]);
    file.attribute("TEXCOORD_0", F32, "VEC2", &[[0.25f32, 0.75]; 3]);
    file.attribute("TANGENT", F32, "VEC4", &[[1.0f32, 0.0, 0.0, -1.0]; 3]);
    let full = file.primitive().clone();
    file.json["meshes"] = json!([{"primitives": [plain]}, {"primitives": [full]}]);
    file.root(json!({"mesh": 1, "translation": [0, 0, 1]}));
    let surface = file.model().surface;
    assert_eq!([surface.colors[0], surface.colors[3]], [Vec4::ONE, Vec4::new(1.0, 0.0, 0.2, 1.0)]);
    assert_eq!([surface.uvs[0][0], surface.uvs[0][3]], [Vec2::ZERO, Vec2::new(0.25, 0.75)]);
    assert_eq!([surface.tangents[0], surface.tangents[3]], [Vec4::ZERO, Vec4::new(1.0, 0.0, 0.0, -1.0)]);
    assert!(surface.uvs[1].is_empty());
}

#[test]
fn the_default_scene_is_scene_then_the_first_then_all_roots() {
    let mut file = Builder::triangle();
    file.push("nodes", json!({"mesh": 0, "translation": [0, 0, 1]}));
    file.push("scenes", json!({"nodes": [1]}));
    file.json["scene"] = json!(1);
    assert_eq!(positions(&file)[0].z, 1.0);
    let root = file.json.as_object_mut().expect("an object");
    root.remove("scene");
    assert_eq!(positions(&file)[0].z, 0.0);
    file.json.as_object_mut().expect("an object").remove("scenes");
    assert_eq!(positions(&file).len(), 6);
}

#[test]
fn a_file_without_triangles_is_an_empty_model() {
    let mut file = Builder::new();
    file.root(json!({"camera": 0}));
    let model = file.model();
    assert!(model.surface.triangles.is_empty() && model.materials.is_empty() && model.rig.is_none());
    let mut points = Builder::triangle();
    points.primitive()["mode"] = json!(0);
    assert!(points.model().notes[0].contains("points"));
}
