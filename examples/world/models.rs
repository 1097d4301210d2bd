//! Fifty models of a planet: rocks of 20,000 triangles, each with colours of its own.

use std::f32::consts::{PI, TAU};
use std::io::Cursor;
use std::path::Path;
use std::{fs, io};

use bevy::math::Vec3;
use image::{ImageFormat, Rgb, RgbImage};
use serde_json::json;

/// Number of models.
pub(crate) const COUNT: usize = 50;
/// Rings and segments of a model, whose triangles are twice their square.
const RINGS: u32 = 100;
/// Side of the texture in texels.
const SIDE: u32 = 1024;

/// The name of a model's file.
pub(crate) fn name(model: usize) -> String {
    format!("rock{model:02}.glb")
}

/// Writes the models into a folder, with settings that make the first start quick, and `setting`. What is there already stays.
pub(crate) fn write(folder: &Path, setting: &str) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let meta = format!(
        "(meta_format_version: \"1.0\", asset: Process(processor: \"bevy_simpliguard::SimpliguardProcess\", settings: (\
         quality: Draft, candidates: Source, faces: [100, 500], texture_size: 256, views: 8, view_size: 128, normal_map: false, \
         {setting})))"
    );
    for model in 0..COUNT {
        let path = folder.join(name(model));
        if !path.exists() {
            fs::write(&path, glb(model as u32)?)?;
        }
        let path = folder.join(format!("{}.meta", name(model)));
        if fs::read(&path).is_ok_and(|there| there == meta.as_bytes()) {
            continue;
        }
        fs::write(path, &meta)?;
    }
    Ok(())
}

/// A number from 0 to 1.
pub(crate) fn chance(seed: u32) -> f32 {
    let mut x = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    for _ in 0..2 {
        x = (x ^ (x >> 15)).wrapping_mul(0x2c1b_3c6d);
    }
    (x >> 8) as f32 / (1 << 24) as f32
}

/// Waves over a sphere, which give a rock its shape and its veins.
fn waves(model: u32, at: Vec3, first: u32, count: u32) -> f32 {
    let wave = |i: u32| {
        let seed = 1013 * model + 37 * i;
        let axis = Vec3::new(chance(seed), chance(seed + 1), chance(seed + 2)) * 2.0 - 1.0;
        let frequency = 2.0_f32.powf(1.0 + 0.6 * i as f32);
        (frequency * axis.normalize_or(Vec3::X).dot(at) + TAU * chance(seed + 3)).sin() / (1.0 + i as f32)
    };
    (first..first + count).map(wave).sum()
}

fn direction(u: f32, v: f32) -> Vec3 {
    let ((sin, cos), (sin_v, cos_v)) = ((TAU * u).sin_cos(), (PI * v).sin_cos());
    Vec3::new(sin_v * cos, cos_v, sin_v * sin)
}

fn texture(model: u32) -> io::Result<Vec<u8>> {
    let base = [0, 1, 2].map(|channel| 60.0 + 130.0 * chance(7 * model + channel));
    let texel = |x: u32, y: u32| {
        let at = direction(x as f32 / SIDE as f32, y as f32 / SIDE as f32);
        let vein = 0.7 + 0.3 * waves(model, at, 3, 5);
        Rgb(base.map(|colour| (colour * vein).clamp(0.0, 255.0) as u8))
    };
    let mut out = Cursor::new(Vec::new());
    RgbImage::from_fn(SIDE, SIDE, texel).write_to(&mut out, ImageFormat::Png).map_err(io::Error::other)?;
    Ok(out.into_inner())
}

fn glb(model: u32) -> io::Result<Vec<u8>> {
    let side = RINGS + 1;
    let (mut positions, mut uvs, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..side * side {
        let (u, v) = ((i % side) as f32 / RINGS as f32, (i / side) as f32 / RINGS as f32);
        let at = direction(u, v);
        positions.extend((at * (1.0 + 0.25 * waves(model, at, 0, 5))).to_array());
        uvs.extend([u, v]);
    }
    for i in (0..side * RINGS).filter(|i| i % side < RINGS) {
        let [a, b, c, d] = [i, i + 1, i + side, i + side + 1];
        indices.extend([a, b, d, a, d, c]);
    }
    let floats = |numbers: &[f32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    let parts = [
        floats(&positions),
        floats(&uvs),
        indices.iter().flat_map(|i: &u32| i.to_le_bytes()).collect(),
        texture(model)?,
    ];
    let (mut bin, mut views) = (Vec::new(), Vec::new());
    for bytes in &parts {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() }));
        bin.extend_from_slice(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
    }
    let vertices = side * side;
    let document = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0, "name": "rock" }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0 } }],
        "textures": [{ "source": 0 }], "images": [{ "bufferView": 3, "mimeType": "image/png" }],
        "buffers": [{ "byteLength": bin.len() }], "bufferViews": views,
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3",
              "min": [-2.0, -2.0, -2.0], "max": [2.0, 2.0, 2.0] },
            { "bufferView": 1, "componentType": 5126, "count": vertices, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5125, "count": indices.len(), "type": "SCALAR" },
        ],
    });
    simpliguard::gltf::binary(&document, &bin).map_err(|bytes| io::Error::other(format!("{bytes} bytes are too many")))
}
