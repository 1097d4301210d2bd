//! Exports of models made by hand: a triangle, and a sheet on two bones.
//!
//! With `SIMPLIGUARD_EXPORT_DIR` set, every file is also written there, for the Khronos validator.

use bytes::Bytes;
use glam::{Mat4, Vec2, Vec3, Vec4};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json};

use super::{ExportParams, export, export_level};
use crate::data::{
    AlphaMode, Bone, Document, Influences, LayerMaterial, Level, LevelLayer, LevelMaterial, LevelMesh, LevelMorph,
    LevelTextures, Model, MorphTarget, Morphs, Rig, TextureFormat, Transmission,
};

mod materials;
mod morphs;
mod nodes;
mod skins;

/// JSON and binary chunk of a GLB.
pub(super) struct Read {
    pub(super) json: Value,
    bin: Vec<u8>,
}

impl Read {
    pub(super) fn new(name: &str, glb: &[u8]) -> Self {
        if let Some(dir) = std::env::var_os("SIMPLIGUARD_EXPORT_DIR") {
            std::fs::write(std::path::Path::new(&dir).join(format!("{name}.glb")), glb).expect("writable folder");
        }
        let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().expect("four bytes")) as usize;
        assert_eq!((&glb[..4], word(4), word(8)), (&b"glTF"[..], 2, glb.len()));
        let length = word(12);
        let json = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
        let bin = if glb.len() > 20 + length { glb[28 + length..].to_vec() } else { Vec::new() };
        Self { json, bin }
    }

    pub(super) fn bytes(&self, accessor: usize, size: usize) -> &[u8] {
        let accessor = &self.json["accessors"][accessor];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().expect("view") as usize];
        let at = |v: &Value| v.as_u64().unwrap_or(0) as usize;
        let start = at(&view["byteOffset"]) + at(&accessor["byteOffset"]);
        assert_eq!(start % 4, 0);
        &self.bin[start..start + size * at(&accessor["count"])]
    }

    pub(super) fn floats(&self, accessor: &Value, width: usize) -> Vec<f32> {
        let bytes = self.bytes(accessor.as_u64().expect("index") as usize, 4 * width);
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }

    pub(super) fn attributes(&self, mesh: usize) -> &Value {
        &self.json["meshes"][mesh]["primitives"][0]["attributes"]
    }

    fn len(&self, key: &str) -> usize {
        self.json[key].as_array().map_or(0, Vec::len)
    }
}

fn le(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A document of one triangle under a moved root, its positions in the second of two buffers, with an external image.
fn triangle_document() -> Document {
    let json = json!({
        "asset": { "version": "2.0", "generator": "hand", "copyright": "someone" },
        "nodes": [{ "name": "part", "mesh": 0 }, { "name": "root", "translation": [1.0, 2.0, 3.0], "children": [0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 1, "TEXCOORD_0": 2 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }],
        "images": [{ "uri": "a.png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5121, "count": 3, "type": "SCALAR" },
            { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 3 },
            { "buffer": 1, "byteOffset": 4, "byteLength": 36 },
            { "buffer": 1, "byteOffset": 16, "byteLength": 24 },
        ],
        "buffers": [{ "byteLength": 3, "uri": "a.bin" }, { "byteLength": 40, "uri": "b.bin" }],
    });
    let mut second = vec![0; 4];
    second.extend(le(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]));
    let mut png = std::io::Cursor::new(Vec::new());
    base_color(255).write_to(&mut png, image::ImageFormat::Png).expect("encodes");
    Document {
        json,
        buffers: vec![Bytes::from_static(&[7, 8, 9, 0, 0]), Bytes::from(second)],
        images: vec![Some((Bytes::from(png.into_inner()), "image/png"))],
        decoded: false,
        block_bytes: Default::default(),
        mesh_nodes: vec![0],
        node_world: vec![Mat4::IDENTITY; 2],
    }
}

fn triangle() -> Model {
    Model { document: triangle_document(), ..Model::empty("hand") }
}

/// Two bones in a row under a root, a clip that turns the second and one that only morphs.
fn two_bones(source_skin: Option<usize>) -> Model {
    let json = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "name": "main", "nodes": [0, 3] }],
        "nodes": [
            { "name": "root", "children": [1], "scale": [2.0, 2.0, 2.0] },
            { "name": "upper", "children": [2] },
            { "name": "lower", "translation": [0.0, 1.0, 0.0] },
            { "name": "body", "mesh": 0, "skin": 0 },
        ],
        "meshes": [{ "weights": [0.0], "primitives": [{
            "attributes": { "POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2 }, "targets": [{ "POSITION": 0 }],
        }]}],
        "skins": [{ "joints": [1, 2], "inverseBindMatrices": 3 }],
        "animations": [
            { "name": "turn", "samplers": [{ "input": 4, "output": 6 }, { "input": 4, "output": 5 }],
              "channels": [
                { "sampler": 0, "target": { "node": 3, "path": "weights" } },
                { "sampler": 1, "target": { "node": 2, "path": "rotation" } },
              ]},
            { "name": "morph", "samplers": [{ "input": 4, "output": 6 }],
              "channels": [{ "sampler": 0, "target": { "node": 3, "path": "weights" } }] },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5121, "count": 3, "type": "VEC4" },
            { "bufferView": 4, "componentType": 5126, "count": 3, "type": "VEC4" },
            { "bufferView": 2, "componentType": 5126, "count": 2, "type": "MAT4" },
            { "bufferView": 3, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1.5] },
            { "bufferView": 3, "byteOffset": 8, "componentType": 5126, "count": 2, "type": "VEC4" },
            { "bufferView": 3, "byteOffset": 40, "componentType": 5126, "count": 2, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 84, "byteLength": 12 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 128 },
            { "buffer": 0, "byteOffset": 224, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 48 },
        ],
        "buffers": [{ "byteLength": 272 }],
    });
    let lower_bind = Mat4::from_translation(Vec3::new(0.0, -1.0, 0.0));
    let mut bin = le(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    bin.extend(le(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]));
    bin.extend([0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0]);
    bin.extend(le(&Mat4::IDENTITY.to_cols_array()));
    bin.extend(le(&lower_bind.to_cols_array()));
    bin.extend(le(&[0.0, 1.5, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]));
    let scale = Mat4::from_scale(Vec3::splat(2.0));
    let bones = vec![
        Bone { node: 1, inverse_bind: Mat4::IDENTITY, rest_world: scale },
        Bone { node: 2, inverse_bind: lower_bind, rest_world: scale * Mat4::from_translation(Vec3::Y) },
    ];
    let document = Document {
        json,
        buffers: vec![Bytes::from(bin)],
        images: Vec::new(),
        decoded: false,
        block_bytes: Default::default(),
        mesh_nodes: vec![3],
        node_world: vec![Mat4::IDENTITY; 4],
    };
    Model { rig: Some(Rig { bones, source_skin, poses: Vec::new() }), document, ..Model::empty("hand") }
}

fn base_color(alpha: u8) -> RgbaImage {
    RgbaImage::from_pixel(4, 4, Rgba([200, 100, 50, alpha]))
}

fn level(budget: u32, skinned: bool) -> Level {
    let blend = Influences { joints: [1, 0, 0, 0], weights: [0.75, 0.25, 0.0, 0.0] };
    let influences = if skinned { vec![Influences::rigid(0), blend, Influences::rigid(1)] } else { Vec::new() };
    Level {
        budget,
        error: 0.01,
        own_joints: false,
        mesh: LevelMesh {
            positions: vec![Vec3::ZERO, Vec3::new(2.0, 0.5, 0.0), Vec3::new(0.0, 4.0, 0.0)],
            normals: vec![Vec3::Z; 3],
            tangents: Vec::new(),
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
            second_uvs: Vec::new(),
            colors: Vec::new(),
            influences,
            triangles: vec![[0, 1, 2]],
            morphs: Vec::new(),
        },
        layers: vec![LevelLayer {
            triangles: 1,
            material: LayerMaterial::Baked(LevelMaterial {
                alpha_mode: AlphaMode::Opaque,
                double_sided: false,
                unlit: false,
                metallic: 0.25,
                roughness: 0.75,
                emissive: Vec3::ZERO,
                base_color: Vec4::ONE,
                transmission: None,
            }),
        }],
        textures: LevelTextures {
            base_color: Some(base_color(255)),
            normal: None,
            occlusion_roughness_metallic: None,
            emissive: None,
            format: TextureFormat::Png,
        },
    }
}

fn levels(skinned: bool) -> [Level; 3] {
    [1000, 2000, 4000].map(|budget| level(budget, skinned))
}

fn drop_source() -> ExportParams {
    ExportParams { keep_source: false }
}
