//! Compressed geometry and images of any bytes, in a model that is sound otherwise.

use serde_json::{Value, json};
use simpliguard::{NoResources, Source};

use crate::import::import_soundly;

/// Decodes the bytes. The first one chooses the decoder, the next three its numbers.
pub fn compressed(bytes: &[u8]) {
    let Some((&[kind, a, b, c], data)) = bytes.split_first_chunk() else { return };
    let numbers = [a, b, c].map(usize::from);
    let json = match kind % 8 {
        0..3 => meshopt(kind % 3, numbers, data.len()),
        3 => draco(numbers, data.len()),
        4 => image("image/ktx2", data.len()),
        5 => image("image/png", data.len()),
        6 => image("image/jpeg", data.len()),
        _ => image("image/webp", data.len()),
    };
    let glb = binary(&json, data);
    import_soundly(&Source { name: "fuzz.glb", bytes: &glb, resources: &NoResources });
}

/// A primitive whose positions or indices are compressed with meshopt.
fn meshopt(kind: u8, [count, stride, filter]: [usize; 3], length: usize) -> Value {
    let mode = ["ATTRIBUTES", "TRIANGLES", "INDICES"][usize::from(kind)];
    let filter = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"][filter % 5];
    let stride = if kind == 0 { 4 * (stride % 8 + 1) } else { [2, 4][stride % 2] };
    let is_attribute = kind == 0;
    let positions = if is_attribute { count } else { 256 };
    let view = json!({"buffer": 1, "byteLength": count * stride, "byteStride": stride, "extensions": {"EXT_meshopt_compression": {
        "buffer": 0, "byteOffset": 0, "byteLength": length, "byteStride": stride, "count": count, "mode": mode, "filter": filter,
    }}});
    let component = if is_attribute { 5126 } else { [5123, 5125][stride / 4] };
    let compressed = json!({"bufferView": 0, "componentType": component, "count": count, "type": if is_attribute { "VEC3" } else { "SCALAR" }});
    // Without a view, all zero.
    let zero = json!({"componentType": 5126, "count": positions, "type": "VEC3"});
    let (accessors, primitive) = if is_attribute {
        (json!([compressed]), json!({"attributes": {"POSITION": 0}}))
    } else {
        (json!([zero, compressed]), json!({"attributes": {"POSITION": 0}, "indices": 1}))
    };
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}], "accessors": accessors, "bufferViews": [view],
        "buffers": [{"byteLength": length}, {"byteLength": count * stride}],
        "extensionsUsed": ["EXT_meshopt_compression"], "extensionsRequired": ["EXT_meshopt_compression"],
    })
}

/// A primitive that is compressed with Draco.
fn draco([vertices, indices, attribute]: [usize; 3], length: usize) -> Value {
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0}, "indices": 1,
            "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": attribute % 4}}},
        }]}],
        "accessors": [
            {"componentType": 5126, "count": vertices, "type": "VEC3"},
            {"componentType": 5125, "count": indices, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": length}], "buffers": [{"byteLength": length}],
        "extensionsUsed": ["KHR_draco_mesh_compression"], "extensionsRequired": ["KHR_draco_mesh_compression"],
    })
}

/// A triangle with an image.
fn image(mime: &str, length: usize) -> Value {
    let texture = if mime == "image/ktx2" {
        json!({"extensions": {"KHR_texture_basisu": {"source": 0}}})
    } else {
        json!({"source": 0})
    };
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}], "textures": [texture],
        "images": [{"bufferView": 0, "mimeType": mime}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": length}], "buffers": [{"byteLength": length}],
        "extensionsUsed": ["KHR_texture_basisu", "EXT_texture_webp"],
    })
}

/// A binary glTF.
fn binary(json: &Value, data: &[u8]) -> Vec<u8> {
    let json = json.to_string();
    let (text, chunk) = (json.len().next_multiple_of(4), data.len().next_multiple_of(4));
    let mut glb = b"glTF".to_vec();
    let numbers = |numbers: &[u32]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    glb.extend(numbers(&[2, (28 + text + chunk) as u32, text as u32, 0x4E4F_534A]));
    glb.extend(format!("{json:<text$}").into_bytes());
    glb.extend(numbers(&[chunk as u32, 0x004E_4942]));
    glb.extend(data);
    glb.resize(glb.len() + chunk - data.len(), 0);
    glb
}
