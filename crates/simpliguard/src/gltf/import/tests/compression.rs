use serde_json::json;

use super::builder::{Builder, F32, U16, import_bytes};
use crate::gltf::ImportLimits;

/// Quads of a grid, `positions` and `indices` compressed; the fallback buffer has no bytes.
fn compressed(extension: &str, version: i32) -> (Builder, Vec<[f32; 3]>) {
    let positions: Vec<[f32; 3]> = (0..64).map(|i| [(i % 8) as f32, (i / 8) as f32, 0.0]).collect();
    let quad = |i: u32| [i, i + 1, i + 8, i + 1, i + 9, i + 8];
    let indices: Vec<u32> = (0..56).filter(|i| i % 8 != 7).flat_map(quad).collect();
    let vertices = ::meshopt::encode_vertex_buffer_level(&positions, 2, Some(version)).expect("vertices");
    let faces = ::meshopt::encode_index_buffer(&indices, positions.len()).expect("faces");
    let (vertex_bytes, face_bytes) = (positions.len() * 12, indices.len() * 2);

    let mut file = Builder::new();
    let packed = [file.view(&vertices), file.view(&faces)].map(|view| file.json["bufferViews"][view].clone());
    let view = |offset: usize, length: usize, packed: &serde_json::Value, count: usize, mode: &str| {
        let mut extra = packed.clone();
        extra["count"] = json!(count);
        extra["byteStride"] = json!(length / count);
        extra["mode"] = json!(mode);
        json!({"buffer": 1, "byteOffset": offset, "byteLength": length, "extensions": {extension: extra}})
    };
    file.json["bufferViews"] = json!([
        view(0, vertex_bytes, &packed[0], positions.len(), "ATTRIBUTES"),
        view(vertex_bytes, face_bytes, &packed[1], indices.len(), "TRIANGLES"),
    ]);
    file.json["buffers"] = json!([
        {"byteLength": vertices.len() + faces.len()},
        {"byteLength": vertex_bytes + face_bytes, "extensions": {extension: {"fallback": true}}},
    ]);
    file.push("accessors", json!({"bufferView": 0, "componentType": F32, "count": positions.len(), "type": "VEC3"}));
    file.push("accessors", json!({"bufferView": 1, "componentType": U16, "count": indices.len(), "type": "SCALAR"}));
    file.push("meshes", json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}));
    file.root(json!({"mesh": 0}));
    file.json["extensionsUsed"] = json!([extension, "KHR_mesh_quantization"]);
    file.json["extensionsRequired"] = json!([extension]);
    (file, positions)
}

#[test]
fn meshopt_views_are_decoded_and_the_extension_leaves_the_json() {
    for (extension, version) in [("EXT_meshopt_compression", 0), ("KHR_meshopt_compression", 1)] {
        let (file, positions) = compressed(extension, version);
        let model = file.model();
        assert_eq!(model.surface.triangles.len(), 98);
        assert!(model.surface.positions.iter().all(|p| positions.contains(&p.to_array())));
        let json = &model.document.json;
        assert!(!json.to_string().contains(extension) && json.get("extensionsRequired").is_none());
        assert_eq!(json["extensionsUsed"], json!(["KHR_mesh_quantization"]));
        assert_eq!(model.document.buffers[1].len(), 64 * 12 + 294 * 2);
        assert_eq!(model.document.buffers[1][..12], bytemuck::cast::<_, [u8; 12]>(positions[0]));
    }
}

#[test]
fn an_extension_that_nothing_uses_is_not_required_any_more() {
    for name in ["EXT_meshopt_compression", "KHR_draco_mesh_compression", "KHR_texture_basisu", "EXT_texture_webp"] {
        let mut file = Builder::triangle();
        file.json["extensionsUsed"] = json!([name]);
        file.json["extensionsRequired"] = json!([name]);
        let document = file.model().document;
        assert!(document.decoded && !document.json.to_string().contains(name), "{name}");
    }
}

#[test]
fn sizes_that_the_decoder_would_assert_are_refused() {
    for (key, value) in [
        ("byteStride", json!(7)),
        ("count", json!(u64::MAX)),
        ("mode", json!("WAVES")),
        ("filter", json!("QUATERNION")),
        ("byteLength", json!(1u64 << 40)),
        ("byteLength", json!(3)),
        ("buffer", json!(7)),
    ] {
        let (mut file, _) = compressed("EXT_meshopt_compression", 0);
        file.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][key] = value;
        let message = file.message();
        assert!(message.contains("buffer view 0") || message.contains("buffer 7"), "{key}: {message}");
    }
    let (mut file, _) = compressed("EXT_meshopt_compression", 0);
    file.json["buffers"][1]["byteLength"] = json!(1u64 << 50);
    assert!(file.message().contains("over the limit"));
}

#[test]
fn damaged_streams_give_an_error_or_a_model() {
    let (file, _) = compressed("KHR_meshopt_compression", 1);
    let bytes = file.glb();
    let start = bytes.len() - 400;
    for at in start..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x5A;
        if let Ok(model) = import_bytes(&damaged, &ImportLimits::default()) {
            super::assert_sound(&model);
        }
    }
}
