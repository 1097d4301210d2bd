//! Two levels of two objects, and what becomes of their materials.

use image::codecs::png::PngEncoder;
use image::{Rgba, RgbaImage};
use serde_json::{Value, json};

use super::*;
use crate::gltf::export::builder::{BufferTarget, Component};

/// The file of an object: a mesh with one primitive for each material.
fn object(materials: Value) -> Builder {
    let mut out = Builder::new("test");
    out.json.insert("materials".into(), materials);
    let corners = [[0.0_f32, 0.0], [1.0, 0.0], [0.5, 1.0]];
    let primitives: Vec<Value> = (0..out.all(Kind::Material).len())
        .map(|material| {
            let uvs = out.push_accessor(&corners, Component::F32, "VEC2", BufferTarget::Vertices);
            json!({ "attributes": { "TEXCOORD_0": uvs }, "material": material })
        })
        .collect();
    out.push(Kind::Mesh, json!({ "primitives": primitives }));
    out
}

/// Adds a square image of one colour; returns its texture.
fn add_texture(out: &mut Builder, side: u32, color: [u8; 4]) -> usize {
    let mut png = Vec::new();
    RgbaImage::from_pixel(side, side, Rgba(color)).write_with_encoder(PngEncoder::new(&mut png)).expect("encodes");
    let view = out.push_view(&png, BufferTarget::None);
    let image = out.push(Kind::Image, json!({ "bufferView": view, "mimeType": "image/png" }));
    out.push(Kind::Texture, json!({ "source": image }))
}

/// Shares the materials of a file and writes them into it.
fn share(out: &mut Builder, most: u32) -> Option<u32> {
    let mut atlas = SharedAtlas::new(most, TextureFormat::Png);
    for mesh in 0..out.all(Kind::Mesh).len() {
        let taken = atlas.take_materials(out, mesh);
        atlas.add(mesh, taken);
    }
    out.json.insert("materials".into(), json!([]));
    atlas.write(out, &Cancellation::default()).expect("writes")
}

fn image_of(out: &Builder, texture: &Value) -> RgbaImage {
    let texture = &out.all(Kind::Texture)[index(texture, "index").expect("a texture")];
    let image = &out.all(Kind::Image)[index(texture, "source").expect("an image")];
    let view = &out.all(Kind::BufferView)[index(image, "bufferView").expect("a view")];
    let start = index(view, "byteOffset").expect("an offset");
    let bytes = &out.bin[start..start + index(view, "byteLength").expect("a length")];
    image::load_from_memory(bytes).expect("an image").into_rgba8()
}

fn uvs_of(out: &Builder, primitive: usize) -> Vec<[f32; 2]> {
    let accessor = &out.all(Kind::Mesh)[0]["primitives"][primitive]["attributes"]["TEXCOORD_0"];
    let accessor = &out.all(Kind::Accessor)[accessor.as_u64().expect("an accessor") as usize];
    let view = &out.all(Kind::BufferView)[index(accessor, "bufferView").expect("a view")];
    let start = index(view, "byteOffset").expect("an offset");
    let number = |at: usize| f32::from_le_bytes(out.bin[at..at + 4].try_into().expect("four bytes"));
    (0..3).map(|i| [number(start + 8 * i), number(start + 8 * i + 4)]).collect()
}

const RED: [u8; 4] = [255, 0, 0, 255];
const BLUE: [u8; 4] = [0, 0, 255, 255];

#[test]
fn levels_with_textures_and_with_plain_colours_share_one_material() {
    let plain = json!({ "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 1, 1], "metallicFactor": 0 } });
    let mut out = object(json!([{ "pbrMetallicRoughness": { "metallicFactor": 0 } }, plain]));
    let texture = add_texture(&mut out, 8, RED);
    out.all_mut(Kind::Material)[0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": texture });
    assert_eq!(share(&mut out, 64), Some(16), "8 x 8 and 4 x 4 texels");
    let [material] = out.all(Kind::Material) else { panic!("one material") };
    let reflection = &material["pbrMetallicRoughness"];
    // What all have in common is a factor.
    assert_eq!((reflection["metallicFactor"].as_f64(), reflection.get("baseColorFactor")), (Some(0.0), None));
    assert!(reflection.get("metallicRoughnessTexture").is_none() && material.get("normalTexture").is_none());
    let image = image_of(&out, &reflection["baseColorTexture"]);
    assert_eq!([(0, 0), (7, 7), (8, 0), (11, 3)].map(|(x, y)| image.get_pixel(x, y).0), [RED, RED, BLUE, BLUE]);
    let primitives = out.all(Kind::Mesh)[0]["primitives"].as_array().expect("primitives");
    assert!(primitives.iter().all(|primitive| primitive["material"] == 0));
    // The borders keep half a texel free: of 8 texels, and of 4.
    let close = |found: [f32; 2], x: f32, y: f32| (found[0] - x / 16.0).abs() + (found[1] - y / 16.0).abs() < 1e-6;
    let (first, second) = (uvs_of(&out, 0), uvs_of(&out, 1));
    assert!(close(first[0], 0.5, 0.5) && close(first[1], 7.5, 0.5) && close(first[2], 4.0, 7.5), "{first:?}");
    assert!(close(second[0], 8.5, 0.5) && close(second[2], 10.0, 3.5), "{second:?}");
}

#[test]
fn factors_that_differ_become_texels() {
    let material = |roughness: f32, emissive: f32, strength: f32| {
        json!({
            "pbrMetallicRoughness": { "roughnessFactor": roughness, "metallicFactor": 1 },
            "emissiveFactor": [emissive, 0, 0],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": strength } },
        })
    };
    let mut out = object(json!([material(0.0, 1.0, 4.0), material(1.0, 1.0, 2.0)]));
    assert_eq!(share(&mut out, 64), Some(8));
    let material = &out.all(Kind::Material)[0];
    let strength = &material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"];
    assert_eq!(strength.as_f64(), Some(4.0));
    let packed = image_of(&out, &material["pbrMetallicRoughness"]["metallicRoughnessTexture"]);
    assert_eq!([packed.get_pixel(0, 0).0, packed.get_pixel(4, 0).0], [[255, 0, 255, 255], [255; 4]]);
    let emissive = image_of(&out, &material["emissiveTexture"]);
    // Half of the light is 188 in sRGB.
    assert_eq!([emissive.get_pixel(0, 0).0[0], emissive.get_pixel(4, 0).0[0]], [255, 188]);
}

#[test]
fn cut_outs_show_the_same_textures_and_clear_surfaces_keep_their_own() {
    let materials = json!([
        { "doubleSided": true },
        { "alphaMode": "MASK", "alphaCutoff": 0.25, "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.5] } },
        { "alphaMode": "BLEND" },
        { "extensions": { "KHR_materials_transmission": {} } },
    ]);
    let mut out = object(materials);
    let mut atlas = SharedAtlas::new(64, TextureFormat::Png);
    let taken = atlas.take_materials(&mut out, 0);
    atlas.add(0, taken);
    let kept = |i: usize| out.all(Kind::Mesh)[0]["primitives"][i].get("material").is_some();
    assert_eq!([0, 1, 2, 3].map(kept), [false, false, true, true]);
    atlas.write(&mut out, &Cancellation::default()).expect("writes");
    let [solid, cut_out] = &out.all(Kind::Material)[4..] else { panic!("two new materials") };
    assert_eq!((&solid["doubleSided"], &cut_out["alphaCutoff"]), (&json!(true), &json!(0.25)));
    let textures = [solid, cut_out].map(|material| material["pbrMetallicRoughness"]["baseColorTexture"].clone());
    assert_eq!(textures[0], textures[1]);
    let image = image_of(&out, &textures[0]);
    assert_eq!([image.get_pixel(0, 0).0[3], image.get_pixel(4, 0).0[3]], [255, 128]);
}

#[test]
fn large_tiles_are_halved_until_all_fit() {
    let textured = |texture: usize| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } });
    let mut out = object(json!([{}, {}, {}]));
    for i in 0..3 {
        let texture = add_texture(&mut out, 64, if i == 0 { RED } else { BLUE });
        out.all_mut(Kind::Material)[i] = textured(texture);
    }
    assert_eq!(share(&mut out, 64), Some(64));
    let image = image_of(&out, &out.all(Kind::Material)[0]["pbrMetallicRoughness"]["baseColorTexture"]);
    assert_eq!([(31, 31), (32, 0), (0, 32)].map(|(x, y)| image.get_pixel(x, y).0), [RED, BLUE, BLUE]);
}

#[test]
fn nothing_to_share_writes_nothing() {
    let mut out = object(json!([{ "alphaMode": "BLEND" }]));
    assert_eq!(share(&mut out, 64), None);
    assert!(out.all(Kind::Texture).is_empty());
}
