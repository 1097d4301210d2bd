//! Small models, made for the tests.

use std::f32::consts::{PI, TAU};
use std::io::Cursor;

use image::{ImageFormat, RgbImage};
use serde_json::{Value, json};

/// A textured globe with hills, as JSON and the buffer `globe.bin`; its texture is `globe.png`. It has
/// `2 * rings * rings` triangles or a few less.
pub(super) fn globe(rings: u32) -> (Value, Vec<u8>) {
    let side = rings + 1;
    let (mut positions, mut uvs, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..side * side {
        let (u, v) = ((i % side) as f32 / rings as f32, (i / side) as f32 / rings as f32);
        let radius = 1.0 + 0.1 * (TAU * u * 5.0).sin() * (PI * v * 4.0).sin() * (PI * v).sin();
        let (ring, height) = ((PI * v).sin() * radius, (PI * v).cos() * radius);
        positions.extend([ring * (TAU * u).cos(), height, ring * (TAU * u).sin()]);
        uvs.extend([u, v]);
    }
    for i in (0..side * rings).filter(|i| i % side < rings) {
        let [a, b, c, d] = [i, i + 1, i + side, i + side + 1];
        indices.extend([a, b, d, a, d, c]);
    }
    let bin = [bytes(&positions), bytes(&uvs), indices.iter().flat_map(|i: &u32| i.to_le_bytes()).collect()].concat();
    let (vertices, uv_start) = (side * side, side * side * 12);
    let json = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "globe" }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0 } }],
        "textures": [{ "source": 0 }],
        "images": [{ "uri": "globe.png" }],
        "buffers": [{ "uri": "globe.bin", "byteLength": bin.len() }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": vertices * 12 },
            { "buffer": 0, "byteOffset": uv_start, "byteLength": vertices * 8 },
            { "buffer": 0, "byteOffset": uv_start + vertices * 8, "byteLength": indices.len() * 4 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3",
              "min": [-1.2, -1.2, -1.2], "max": [1.2, 1.2, 1.2] },
            { "bufferView": 1, "componentType": 5126, "count": vertices, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5125, "count": indices.len(), "type": "SCALAR" },
        ],
    });
    (json, bin)
}

/// One globe as a binary glTF, without a texture.
pub(super) fn globe_glb(rings: u32) -> Vec<u8> {
    globe_glb_coloured(rings, 0.8)
}

/// As [`globe_glb`], with so much red.
pub(super) fn globe_glb_coloured(rings: u32, red: f32) -> Vec<u8> {
    let (json, bin) = one_file(rings, red);
    glb(&json, bin)
}

/// As [`globe_glb`], with `megabytes` of nothing behind it.
pub(super) fn heavy_glb(rings: u32, megabytes: usize, fill: u8) -> Vec<u8> {
    let (mut json, mut bin) = one_file(rings, 0.8);
    bin.resize(bin.len() + megabytes * 1_000_000, fill);
    json["buffers"][0]["byteLength"] = json!(bin.len());
    glb(&json, bin)
}

fn one_file(rings: u32, red: f32) -> (Value, Vec<u8>) {
    let (mut json, bin) = globe(rings);
    for key in ["textures", "images"] {
        json.as_object_mut().expect("an object").remove(key);
    }
    json["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorFactor": [red, 0.3, 0.2, 1.0] } }]);
    json["buffers"][0].as_object_mut().expect("an object").remove("uri");
    (json, bin)
}

/// A binary glTF of JSON and one buffer.
pub(super) fn glb(json: &Value, mut bin: Vec<u8>) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let word = |n: usize| (n as u32).to_le_bytes();
    let mut out = b"glTF".to_vec();
    for part in [word(2), word(28 + text.len() + bin.len()), word(text.len()), *b"JSON"] {
        out.extend(part);
    }
    out.extend(text);
    out.extend(word(bin.len()));
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

/// A picture with stripes of a colour.
pub(super) fn png(colour: [u8; 3]) -> Vec<u8> {
    let picture = RgbImage::from_fn(64, 64, |x, _| image::Rgb(if x / 8 % 2 == 0 { colour } else { [255; 3] }));
    let mut out = Vec::new();
    picture.write_to(&mut Cursor::new(&mut out), ImageFormat::Png).expect("encodes");
    out
}

fn bytes(floats: &[f32]) -> Vec<u8> {
    floats.iter().flat_map(|f| f.to_le_bytes()).collect()
}
