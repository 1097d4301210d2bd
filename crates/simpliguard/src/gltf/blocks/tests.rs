use std::io::Cursor;

use image::{DynamicImage, ImageFormat, RgbaImage};
use serde_json::{Value, json};
use simpliguard_texture::{BlockTexture, ImageExtras};

use super::compress_textures;
use crate::gltf::glb::{binary, split};
use crate::gltf::{ImportLimits, import, texture_memory};
use crate::{Cancellation, NoResources, Source};

/// The longest side of the images.
const SIDE: u32 = 64;

fn picture(width: u32, height: u32) -> RgbaImage {
    RgbaImage::from_fn(width, height, |x, y| [3 * x, 4 * y, 50 + x + y, 255].map(|byte| byte.min(255) as u8).into())
}

fn png(image: RgbaImage) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    DynamicImage::from(image).write_to(&mut out, ImageFormat::Png).expect("writes");
    out.into_inner()
}

/// A triangle whose material has colours of 64 x 32 texels, normals of 63 x 63 and metalness of 4 x 4.
fn triangle() -> Vec<u8> {
    let corners: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let corners: Vec<u8> = corners.into_iter().flat_map(f32::to_le_bytes).collect();
    let images = [picture(SIDE, 32), picture(63, 63), picture(4, 4)].map(png);
    let (mut buffer, mut views) = (Vec::new(), Vec::new());
    for bytes in images.iter().chain([&corners, &vec![9; 3]]) {
        buffer.resize(buffer.len().next_multiple_of(4), 0);
        views.push(json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": bytes.len() }));
        buffer.extend_from_slice(bytes);
    }
    let image = |view: usize| json!({ "bufferView": view, "mimeType": "image/png" });
    let mut colours = image(0);
    colours["extras"] = json!({ "of": "another program" });
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "accessors": [{
            "bufferView": 3, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0],
        }],
        "materials": [{
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 2 } },
            "normalTexture": { "index": 1 },
        }],
        "textures": [{ "source": 0 }, { "source": 1 }, { "source": 2 }],
        "images": [colours, image(1), image(2)],
        "bufferViews": views,
        "buffers": [{ "byteLength": buffer.len() }],
        "extensionsUsed": ["EXT_of_another_program"],
        "extensions": { "EXT_of_another_program": { "bufferView": 4 } },
    });
    binary(&document, &buffer).expect("a small file")
}

fn compressed(glb: &[u8]) -> Vec<u8> {
    compress_textures("triangle.glb", glb, &Cancellation::default()).expect("compresses")
}

/// The JSON of a file, and the bytes of its buffer views.
fn read(glb: &[u8]) -> (Value, Vec<Vec<u8>>) {
    let chunks = split(glb).expect("a binary glTF");
    let json: Value = serde_json::from_slice(chunks.json).expect("JSON");
    let number = |view: &Value, key: &str| view[key].as_u64().expect("a number") as usize;
    let bytes = |view: &Value| {
        let start = number(view, "byteOffset");
        chunks.bin.expect("a buffer")[start..start + number(view, "byteLength")].to_vec()
    };
    let views = json["bufferViews"].as_array().expect("views").iter().map(bytes).collect();
    (json, views)
}

#[test]
fn an_image_of_whole_blocks_lies_in_blocks_beside_a_small_one() {
    let (json, views) = read(&compressed(&triangle()));
    let image = &json["images"][0];
    let ImageExtras { simpliguard } = serde_json::from_value(image["extras"].clone()).expect("the blocks");
    let texture = simpliguard.bc7;
    assert_eq!(texture, BlockTexture { buffer_view: 5, width: SIDE, height: 32, srgb: true });
    assert_eq!(image["extras"]["of"], "another program");
    let blocks = texture.inflate(&views[5]).expect("the blocks of this texture");
    let decoded = texture.decode(&blocks, 1);
    assert!(decoded.iter().zip(picture(SIDE, 32).as_raw()).all(|(a, b)| a.abs_diff(*b) <= 12));
    let small = image::load_from_memory(&views[image["bufferView"].as_u64().expect("a view") as usize]).expect("a PNG");
    assert_eq!((small.width(), small.height(), small.color()), (32, 16, image::ColorType::Rgb8));
}

#[test]
fn all_else_stays_as_it_is() {
    let (before, after) = (triangle(), compressed(&triangle()));
    let ((before, old), (after, new)) = (read(&before), read(&after));
    for key in ["nodes", "meshes", "accessors", "materials", "textures", "extensions"] {
        assert_eq!(before[key], after[key], "{key}");
    }
    // Images that are no whole blocks, or too small to gain.
    assert_eq!(before["images"].as_array().expect("images")[1..], after["images"].as_array().expect("images")[1..]);
    assert_eq!(old[1..], new[1..5]);
    assert!(after["buffers"].as_array().expect("buffers").len() == 1 && new[0].len() < old[0].len());
}

#[test]
fn the_import_decodes_blocks() {
    let glb = compressed(&triangle());
    let source = Source { name: "triangle.glb", bytes: &glb, resources: &NoResources };
    let model = import(&source, &ImportLimits::default()).expect("imports");
    let document = &model.document;
    // Blocks of seven mipmaps, and texels of six.
    let expected = [16 * (128 + 32 + 8 + 2 + 1 + 1 + 1), 4 * (63 * 63 + 31 * 31 + 15 * 15 + 7 * 7 + 9 + 1)];
    assert_eq!([0, 1].map(|texture| texture_memory(document, texture)), expected.map(Some));
    assert_eq!(document.json["images"][0]["extras"], json!({ "of": "another program" }));
}
