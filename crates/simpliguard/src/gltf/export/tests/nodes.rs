//! Where levels stand in the document, and what is left of the source.

use super::*;

#[test]
fn source_stays_in_front_in_one_buffer() {
    let model = triangle();
    let read = Read::new("triangle", &export(&model, &levels(false), &ExportParams::default()).expect("exports"));
    let (out, source) = (&read.json, &model.document.json);
    assert_eq!(out["buffers"].as_array().map(Vec::len), Some(1));
    assert!(out["buffers"][0].get("uri").is_none());
    assert_eq!(out["meshes"][0], source["meshes"][0]);
    assert_eq!(out["materials"][0], source["materials"][0]);
    assert_eq!(out["nodes"][0], source["nodes"][0]);
    assert_eq!(out["asset"]["copyright"], "someone");
    assert_eq!(read.floats(&json!(1), 3)[3], 1.0);
    assert_eq!(out["bufferViews"][1]["byteOffset"], 8);
    assert!(out["images"][0].get("uri").is_none());
    assert_eq!(out["images"][0]["mimeType"], "image/png");
}

#[test]
fn a_source_without_scenes_gets_one_with_its_roots() {
    let read = Read::new("scenes", &export(&triangle(), &levels(false), &ExportParams::default()).expect("exports"));
    assert_eq!(read.json["scenes"][0], json!({ "nodes": [1] }));
    assert_eq!(read.json["scene"], 0);
}

#[test]
fn lods_stand_once_on_the_root_in_falling_detail() {
    let read = Read::new("lods", &export(&triangle(), &levels(false), &ExportParams::default()).expect("exports"));
    let nodes = &read.json["nodes"];
    assert_eq!(nodes[1]["extensions"]["MSFT_lod"]["ids"], json!([4, 3, 2]));
    let coverages = nodes[1]["extras"]["MSFT_screencoverage"].as_array().expect("one for the source and each level");
    assert!(coverages.len() == 4 && coverages[3] == 0.0, "{coverages:?}");
    assert_eq!(nodes[4]["extras"]["simpliguard"]["budget"], 4000);
    let smallest = &nodes[2]["extras"]["simpliguard"];
    assert_eq!(smallest["level"], 1);
    assert_eq!(smallest["faces"], 1);
    assert_eq!(smallest["error"], json!(0.01));
    assert_eq!(smallest["replaces"], json!([0]));
    assert_eq!(read.json["extensionsUsed"], json!(["MSFT_lod"]));
    assert!(read.json.get("extensionsRequired").is_none());
}

#[test]
fn static_levels_stand_in_the_world_and_share_node_and_mesh_with_their_scene() {
    let read = Read::new("static", &export(&triangle(), &levels(false), &ExportParams::default()).expect("exports"));
    assert_eq!(read.json["scenes"][1], json!({ "name": "LOD1", "nodes": [2] }));
    assert_eq!(read.json["scenes"][3], json!({ "name": "LOD3", "nodes": [4] }));
    assert_eq!((read.len("nodes"), read.len("meshes"), read.len("samplers")), (5, 4, 1));
    let node = &read.json["nodes"][2];
    assert!(["translation", "rotation", "scale", "matrix", "skin"].iter().all(|k| node.get(k).is_none()));
    let position = read.attributes(1)["POSITION"].as_u64().expect("index") as usize;
    assert_eq!(read.json["accessors"][position]["max"], json!([2.0, 4.0, 0.0]));
    let indices = &read.json["meshes"][1]["primitives"][0]["indices"];
    assert_eq!(read.json["accessors"][indices.as_u64().expect("index") as usize]["componentType"], 5123);
}

#[test]
fn of_several_roots_the_first_with_a_mesh_has_the_lods() {
    let mut model = triangle();
    model.document.json["nodes"].as_array_mut().expect("array").insert(0, json!({ "name": "empty" }));
    model.document.json["nodes"][2]["children"] = json!([1]);
    model.document.mesh_nodes = vec![1];
    let read = Read::new("roots", &export(&model, &levels(false), &ExportParams::default()).expect("exports"));
    assert!(read.json["nodes"][0].get("extensions").is_none());
    assert!(read.json["nodes"][2]["extensions"]["MSFT_lod"].is_object());
}

#[test]
fn dropped_sources_keep_nodes_and_clips_and_lose_meshes() {
    let model = two_bones(Some(0));
    let read = Read::new("dropped", &export(&model, &levels(true), &drop_source()).expect("exports"));
    assert_eq!(read.len("meshes"), 3);
    assert_eq!(["mesh", "skin", "weights"].map(|k| read.json["nodes"][3].get(k)), [None; 3]);
    assert_eq!(read.json["nodes"][2], model.document.json["nodes"][2]);
    assert_eq!(
        read.json["animations"][0]["channels"],
        json!([{ "sampler": 0, "target": { "node": 2, "path": "rotation" } }])
    );
    let output = read.json["animations"][0]["samplers"][0]["output"].clone();
    assert_eq!(read.floats(&output, 4), [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    // The clip that only morphed lasts as long as before.
    let still = &read.json["animations"][1];
    assert_eq!(still["name"], "morph");
    assert_eq!(read.floats(&still["samplers"][0]["input"], 1), [0.0, 1.5]);
    let kept = Read::new("kept", &export(&model, &levels(true), &ExportParams::default()).expect("exports"));
    assert!(read.bin.len() < kept.bin.len());
}

#[test]
fn dropped_static_sources_lose_materials_and_textures() {
    let read = Read::new("dropped_static", &export(&triangle(), &levels(false), &drop_source()).expect("exports"));
    assert_eq!(["meshes", "materials", "textures", "images", "accessors"].map(|k| read.len(k)), [3, 3, 3, 3, 12]);
    assert_eq!(read.json["nodes"][0], json!({ "name": "part" }));
    assert_eq!(read.json["nodes"][4]["mesh"], 2);
}

#[test]
fn old_lods_are_replaced() {
    let mut model = triangle();
    let nodes = model.document.json["nodes"].as_array_mut().expect("array");
    nodes[0]["extensions"] = json!({ "MSFT_lod": { "ids": [2] } });
    nodes[0]["extras"] = json!({ "MSFT_screencoverage": [0.5, 0.1] });
    nodes.push(json!({ "mesh": 0 }));
    model.document.json["extensionsUsed"] = json!(["MSFT_lod"]);
    model.document.json["scenes"] = json!([{ "nodes": [1] }]);
    let read = Read::new("replaced", &export(&model, &levels(false), &ExportParams::default()).expect("exports"));
    assert_eq!(read.json["nodes"][0], json!({ "name": "part", "mesh": 0 }));
    assert_eq!(read.json["nodes"][1]["extensions"]["MSFT_lod"]["ids"], json!([5, 4, 3]));
    let dropped = Read::new("replaced_dropped", &export(&model, &levels(false), &drop_source()).expect("exports"));
    assert_eq!(dropped.len("meshes"), 3);
}

#[test]
fn a_static_level_alone_is_one_node() {
    let read = Read::new("level_static", &export_level(&triangle(), &level(1000, false)).expect("exports"));
    assert_eq!(read.json["scenes"], json!([{ "nodes": [0] }]));
    assert_eq!(["nodes", "meshes", "materials", "images"].map(|k| read.len(k)), [1; 4]);
    assert!(read.json.get("extensionsUsed").is_none());
}

#[test]
fn levels_whose_arrays_do_not_fit_are_refused() {
    let mut short = level(1000, false);
    short.mesh.normals.pop();
    let mut outside = level(1000, false);
    outside.mesh.triangles[0][2] = 3;
    let mut poisoned = level(1000, false);
    poisoned.mesh.positions[0].x = f32::NAN;
    let mut boneless = level(1000, true);
    boneless.mesh.influences[0].joints[0] = 9;
    for level in [short, outside, poisoned, boneless] {
        assert!(export(&two_bones(Some(0)), &[level], &ExportParams::default()).is_err());
    }
}

#[test]
fn equal_input_gives_equal_bytes() {
    let once = || export(&two_bones(None), &levels(true), &ExportParams::default()).expect("exports");
    assert_eq!(once(), once());
}
