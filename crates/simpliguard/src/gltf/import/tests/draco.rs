use glam::Vec4;
use serde_json::json;

use super::blobs::{draco_grid, draco_sequential};
use super::builder::{Builder, F32, U8, U16, import_bytes};
use crate::gltf::{ExportParams, ImportLimits, export, import};
use crate::{NoResources, Source};

const NAME: &str = "KHR_draco_mesh_compression";

/// A file whose only primitive is a compressed grid of 12 vertices and 12 triangles.
fn compressed(blob: &[u8]) -> Builder {
    let mut file = Builder::new();
    let view = file.view(blob);
    let mut attributes = json!({});
    for (name, component, shape, normalized) in [
        ("POSITION", F32, "VEC3", false),
        ("NORMAL", F32, "VEC3", false),
        ("TEXCOORD_0", F32, "VEC2", false),
        ("COLOR_0", U8, "VEC4", true),
        ("JOINTS_0", U16, "VEC4", false),
        ("WEIGHTS_0", U8, "VEC4", true),
    ] {
        let accessor = json!({"componentType": component, "type": shape, "count": 12, "normalized": normalized});
        attributes[name] = json!(file.push("accessors", accessor));
    }
    let indices = file.push("accessors", json!({"componentType": U16, "type": "SCALAR", "count": 36}));
    let ids = json!({"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 5, "COLOR_0": 3, "JOINTS_0": 4, "WEIGHTS_0": 7});
    let extension = json!({NAME: {"bufferView": view, "attributes": ids}});
    file.push(
        "meshes",
        json!({"primitives": [{"attributes": attributes, "indices": indices, "extensions": extension}]}),
    );
    file.root(json!({"mesh": 0, "skin": 0}));
    file.root(json!({"children": [2]}));
    file.push("nodes", json!({}));
    file.push("skins", json!({"joints": [1, 2]}));
    file.json["extensionsUsed"] = json!([NAME]);
    file.json["extensionsRequired"] = json!([NAME]);
    file
}

#[test]
fn every_attribute_is_decoded_by_its_id() {
    for blob in [draco_grid(), draco_sequential()] {
        let model = compressed(&blob).model();
        let surface = &model.surface;
        assert_eq!((surface.triangles.len(), surface.positions.len()), (12, 12));
        for (vertex, position) in surface.positions.iter().enumerate() {
            let (x, y) = (position.x.round(), position.y.round());
            assert!((position.x - x).abs() < 2e-3 && (position.y - y).abs() < 2e-3, "{position}");
            assert!(surface.normals[vertex].z > 0.99);
            assert!((surface.uvs[0][vertex] * 4.0 - glam::Vec2::new(x, y)).length() < 1e-2);
            let color = Vec4::new(x * 60.0, y * 80.0, 7.0, 255.0) / 255.0;
            assert!((surface.colors[vertex] - color).length() < 1e-6);
            let influences = surface.influences[vertex];
            let even = x as i32 % 2 == 0;
            let weight = if even { 200.0 / 255.0 } else { 1.0 };
            assert!((influences.weights[0] - weight).abs() < 1e-6, "{influences:?}");
        }
    }
}

#[test]
fn the_document_holds_ordinary_accessors_that_import_again() {
    let file = compressed(&draco_grid());
    let model = file.model();
    assert!(model.document.decoded && !model.document.json.to_string().contains("draco"));
    let glb = export(&model, &[], &ExportParams::default()).expect("exports");
    let again = import_bytes(&glb, &ImportLimits::default()).expect("imports");
    assert!(!again.document.decoded);
    assert_eq!(again.surface.positions, model.surface.positions);
    assert_eq!(again.surface.triangles, model.surface.triangles);
    assert_eq!(again.surface.colors, model.surface.colors);
    assert_eq!(again.surface.influences, model.surface.influences);
    // The compressed bytes are gone.
    assert!(!glb.windows(5).any(|bytes| bytes == b"DRACO"));
}

#[test]
fn bounds_are_those_of_the_decoded_positions() {
    let mut file = compressed(&draco_grid());
    let accessor =
        file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"].as_u64().expect("an index") as usize;
    file.json["accessors"][accessor]["min"] = json!([-9.0, -9.0, -9.0]);
    file.json["accessors"][accessor]["max"] = json!([0.0, 9.0, 9.0]);
    let model = file.model();
    let (low, high) = crate::data::bounds(&model.surface.positions);
    let accessor = &model.document.json["accessors"][accessor];
    assert_eq!((&accessor["min"], &accessor["max"]), (&json!(low.to_array()), &json!(high.to_array())));
}

#[test]
fn declared_component_types_are_met() {
    let mut file = compressed(&draco_grid());
    let at = |file: &Builder, name: &str| {
        file.json["meshes"][0]["primitives"][0]["attributes"][name].as_u64().expect("an index") as usize
    };
    let (joints, weights, colors) = (at(&file, "JOINTS_0"), at(&file, "WEIGHTS_0"), at(&file, "COLOR_0"));
    file.json["accessors"][joints]["componentType"] = json!(U8);
    for accessor in [weights, colors] {
        file.json["accessors"][accessor]["componentType"] = json!(F32);
        file.json["accessors"][accessor]["normalized"] = json!(false);
    }
    let (found, expected) = (file.model(), compressed(&draco_grid()).model());
    assert_eq!(found.surface.influences, expected.surface.influences);
    assert_eq!(found.surface.colors, expected.surface.colors);
}

#[test]
fn morph_targets_beside_compressed_vertices_are_kept() {
    let mut file = compressed(&draco_sequential());
    let offsets: Vec<[f32; 3]> = (0..12).map(|i| [0.0, 0.0, i as f32]).collect();
    let target = file.accessor(F32, "VEC3", &offsets);
    file.primitive()["targets"] = json!([{"POSITION": target}]);
    file.json["meshes"][0]["weights"] = json!([1.0]);
    file.json["nodes"][0].as_object_mut().expect("an object").remove("skin");
    let model = file.model();
    let expected = |x: f32, y: f32| 4.0 * y + x + (x * y % 3.0) * 0.5;
    assert!(model.surface.positions.iter().all(|p| (p.z - expected(p.x.round(), p.y.round())).abs() < 2e-3));
}

#[test]
fn primitives_of_one_geometry_share_it_and_plain_ones_stay() {
    let mut file = compressed(&draco_grid());
    let shared = file.primitive().clone();
    let positions = file.accessor(F32, "VEC3", &[[9.0f32, 0.0, 0.0], [9.0, 1.0, 0.0], [9.0, 0.0, 1.0]]);
    let primitives = file.json["meshes"][0]["primitives"].as_array_mut().expect("a list");
    primitives.push(json!({"attributes": {"POSITION": positions}}));
    primitives.push(shared);
    primitives[2]["material"] = json!(0);
    file.push("materials", json!({"name": "paint"}));
    let model = file.model();
    assert_eq!(model.surface.triangles.len(), 25);
    assert_eq!(model.document.json["accessors"].as_array().map(Vec::len), Some(8));
}

#[test]
fn plain_data_beside_an_optional_extension_is_used_unchanged() {
    let mut file = Builder::triangle();
    let indices = file.accessor(U16, "SCALAR", &[0u16, 1, 2]);
    let view = file.view(b"no draco");
    file.primitive()["indices"] = json!(indices);
    file.primitive()["extensions"] = json!({NAME: {"bufferView": view, "attributes": {"POSITION": 0}}});
    file.json["extensionsUsed"] = json!([NAME]);
    let model = file.model();
    assert_eq!(model.surface.triangles.len(), 1);
    assert!(!model.document.decoded && model.document.json.to_string().contains(NAME));

    file.json["extensionsRequired"] = json!([NAME]);
    let message = file.message();
    assert!(message.contains("mesh 0, primitive 0") && message.contains("Draco"), "{message}");
}

#[test]
fn the_limit_on_triangles_holds_before_they_are_decoded() {
    let file = compressed(&draco_grid());
    let within = |triangles| file.import_within(&ImportLimits { triangles, ..ImportLimits::default() });
    assert!(within(12).is_ok());
    let message = within(11).expect_err("an error").to_string();
    assert!(message.contains("test.glb") && message.contains("12 faces"), "{message}");
}

#[test]
fn a_wrong_id_or_view_is_named() {
    let broken = |pointer: &str, value: serde_json::Value| {
        let mut file = compressed(&draco_grid());
        *file.primitive().pointer_mut(pointer).expect("a value") = value;
        file.message()
    };
    let extension = format!("/extensions/{NAME}");
    assert!(broken(&format!("{extension}/attributes/COLOR_0"), json!(99)).contains("no attribute 99 for COLOR_0"));
    assert!(broken(&format!("{extension}/bufferView"), json!(99)).contains("buffer view 99"));
    assert!(broken("/attributes/COLOR_0", json!(99)).contains("COLOR_0"));
}

#[test]
fn broken_bytes_give_an_error_or_a_sound_model() {
    for blob in [draco_grid(), draco_sequential()] {
        let file = compressed(&blob).glb();
        let start = file.windows(5).position(|bytes| bytes == b"DRACO").expect("the blob");
        let try_import = |blob: &[u8]| {
            let mut bytes = file.clone();
            bytes[start..start + blob.len()].copy_from_slice(blob);
            let source = Source { name: "test.glb", bytes: &bytes, resources: &NoResources };
            match import(&source, &ImportLimits::default()) {
                Ok(model) => super::assert_sound(&model),
                Err(error) => assert!(error.to_string().contains("test.glb"), "{error}"),
            }
        };
        for at in 0..blob.len() {
            let mut changed = blob.clone();
            changed[at] ^= if at % 2 == 0 { 0x5A } else { 0x81 };
            try_import(&changed);
        }
        for length in (0..blob.len()).step_by(7) {
            let error = compressed(&blob[..length]).import();
            assert!(error.is_err(), "{length} of {} bytes were accepted", blob.len());
        }
    }
}
