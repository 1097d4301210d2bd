//! Exports of models made by hand: a triangle, and a sheet on two bones.
//!
//! With `SIMPLIGUARD_EXPORT_DIR` set, every file is also written there, for the Khronos validator.

use bytes::Bytes;
use glam::{Mat4, Vec2, Vec3};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use serde_json::{Value, json};

use super::{ExportOptions, export, export_level};
use crate::model::{
    AlphaMode, Bone, Document, Influences, Level, LevelMaterial, LevelMesh, LevelMorph, LevelTextures, Model,
    MorphTarget, Morphs, Rig,
};
use crate::settings::{SourceGeometry, TextureFormat};

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
            influences,
            triangles: vec![[0, 1, 2]],
            morphs: Vec::new(),
        },
        material: LevelMaterial {
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            metallic: 0.25,
            roughness: 0.75,
            emissive: Vec3::ZERO,
        },
        textures: LevelTextures {
            base_color: base_color(255),
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

fn drop_source() -> ExportOptions {
    ExportOptions { source: SourceGeometry::Drop, ..ExportOptions::default() }
}

#[test]
fn source_stays_in_front_in_one_buffer() {
    let model = triangle();
    let read = Read::new("triangle", &export(&model, &levels(false), &ExportOptions::default()).expect("exports"));
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
    let read = Read::new("scenes", &export(&triangle(), &levels(false), &ExportOptions::default()).expect("exports"));
    assert_eq!(read.json["scenes"][0], json!({ "nodes": [1] }));
    assert_eq!(read.json["scene"], 0);
}

#[test]
fn lods_stand_once_on_the_root_in_falling_detail() {
    let read = Read::new("lods", &export(&triangle(), &levels(false), &ExportOptions::default()).expect("exports"));
    let nodes = &read.json["nodes"];
    assert_eq!(nodes[1]["extensions"]["MSFT_lod"]["ids"], json!([4, 3, 2]));
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
    let read = Read::new("static", &export(&triangle(), &levels(false), &ExportOptions::default()).expect("exports"));
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
    let read = Read::new("roots", &export(&model, &levels(false), &ExportOptions::default()).expect("exports"));
    assert!(read.json["nodes"][0].get("extensions").is_none());
    assert!(read.json["nodes"][2]["extensions"]["MSFT_lod"].is_object());
}

#[test]
fn skinned_levels_reuse_the_skin_and_reproduce_the_rest_pose() {
    let model = two_bones(Some(0));
    let read = Read::new("skinned", &export(&model, &levels(true), &ExportOptions::default()).expect("exports"));
    assert_eq!(read.json["nodes"][4]["skin"], 0);
    assert_eq!(read.json["nodes"][4]["mesh"], 1);
    // Both bones scale by two in the rest pose.
    assert_eq!(read.floats(&read.attributes(1)["POSITION"], 3), [0.0, 0.0, 0.0, 1.0, 0.25, 0.0, 0.0, 2.0, 0.0]);
    assert_eq!(read.floats(&read.attributes(1)["WEIGHTS_0"], 4)[4..8], [0.75, 0.25, 0.0, 0.0]);
    let joints = read.attributes(1)["JOINTS_0"].as_u64().expect("index") as usize;
    assert_eq!(read.json["accessors"][joints]["componentType"], 5121);
    assert_eq!(read.bytes(joints, 4), [0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
}

#[test]
fn a_skinned_levels_scene_has_its_own_joints_and_shares_mesh_and_matrices() {
    let model = two_bones(Some(0));
    let read = Read::new("alone", &export(&model, &levels(true), &ExportOptions::default()).expect("exports"));
    let scene = &read.json["scenes"][1];
    assert_eq!(scene["name"], "LOD1");
    let nodes = &read.json["nodes"];
    let root = scene["nodes"][0].as_u64().expect("index") as usize;
    let alone = scene["nodes"][1].as_u64().expect("index") as usize;
    assert_eq!((&nodes[root]["name"], &nodes[root]["scale"]), (&json!("root LOD1"), &json!([2.0, 2.0, 2.0])));
    assert_eq!(nodes[alone]["mesh"], nodes[4]["mesh"]);
    let skin = &read.json["skins"][nodes[alone]["skin"].as_u64().expect("index") as usize];
    assert_eq!(skin["inverseBindMatrices"], 3);
    assert_eq!(skin["joints"], json!([root + 1, root + 2]));
    // One per level: the source's, and three copies.
    assert_eq!(read.len("skins"), 4);
    // The source's mesh node has no copy.
    assert_eq!(read.len("nodes"), 4 + 3 * 5);
}

#[test]
fn a_level_on_fewer_joints_has_a_skin_of_its_own_with_the_same_matrices() {
    let model = two_bones(Some(0));
    let mut levels = levels(true);
    levels[0].own_joints = true;
    levels[0].mesh.influences.fill(Influences::rigid(1));
    let read = Read::new("narrowed", &export(&model, &levels, &ExportOptions::default()).expect("exports"));
    let skin = |node: usize| &read.json["skins"][read.json["nodes"][node]["skin"].as_u64().expect("index") as usize];
    let matrices = |skin: &Value| read.floats(&skin["inverseBindMatrices"], 16);
    let levels: Vec<usize> =
        (0..read.len("nodes")).filter(|&n| read.json["nodes"][n].get("extras").is_some()).collect();
    let [small, large] = [levels[0], levels[1]].map(skin);
    assert_eq!((&small["joints"], &large["joints"]), (&json!([2]), &json!([1, 2])));
    assert_eq!(matrices(small)[..], matrices(large)[16..]);
    let alone = export_level(&model, &Level { own_joints: true, ..level(1000, true) }).expect("exports");
    assert_eq!(Read::new("alone", &alone).json["skins"][0]["joints"], json!([1, 2]));
}

#[test]
fn a_merged_skin_has_one_joint_per_node_and_binds_in_the_world() {
    let mut model = two_bones(None);
    let rig = model.rig.as_mut().expect("rig");
    // The same joint, bound in other units.
    let double = Bone { inverse_bind: Mat4::from_scale(Vec3::splat(3.0)), ..rig.bones[0] };
    rig.bones.push(double);
    let mut level = level(1000, true);
    level.mesh.influences[0] = Influences { joints: [2, 0, 0, 0], weights: [0.5, 0.5, 0.0, 0.0] };
    let read = Read::new("merged", &export(&model, &[level], &ExportOptions::default()).expect("exports"));
    assert_eq!(read.json["skins"][1]["joints"], json!([1, 2]));
    assert_eq!(read.floats(&read.attributes(1)["WEIGHTS_0"], 4)[..4], [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(read.floats(&read.attributes(1)["POSITION"], 3)[3..6], [2.0, 0.5, 0.0]);
    let matrices = read.floats(&read.json["skins"][1]["inverseBindMatrices"], 16);
    assert_eq!((matrices[0], matrices[16], matrices[16 + 13]), (0.5, 0.5, -1.0));
}

#[test]
fn a_merged_skin_over_several_roots_gets_a_common_one() {
    let mut model = two_bones(None);
    model.document.json["nodes"][1]["children"] = json!([]);
    model.document.json["nodes"][1].as_object_mut().expect("object").remove("children");
    model.document.json["scenes"][0]["nodes"] = json!([0, 3, 2]);
    let read = Read::new("joined", &export(&model, &levels(true), &ExportOptions::default()).expect("exports"));
    assert_eq!(read.json["scenes"][0]["nodes"], json!([4]));
    assert_eq!(read.json["nodes"][4]["children"], json!([0, 3, 2]));
    assert_eq!(read.json["nodes"][4]["extensions"]["MSFT_lod"]["ids"].as_array().map(Vec::len), Some(3));
    Read::new("joined_level", &export_level(&model, &level(1000, true)).expect("exports"));
}

#[test]
fn more_joints_than_engines_take_are_refused_by_number() {
    let mut model = two_bones(None);
    let rig = model.rig.as_mut().expect("rig");
    rig.bones = (0..300).map(|node| Bone { node, ..rig.bones[0] }).collect();
    let mut level = level(1000, true);
    let bones = |first: u16| Influences { joints: [first, first + 1, first + 2, first + 3], weights: [0.25; 4] };
    level.mesh.influences = (0..75).map(|v| bones(4 * v)).collect();
    level.mesh.positions = vec![Vec3::ZERO; 75];
    level.mesh.normals = vec![Vec3::Z; 75];
    level.mesh.uvs = vec![Vec2::ZERO; 75];
    let message = export(&model, &[level], &ExportOptions::default()).expect_err("refused").to_string();
    assert!(message.contains("300 joints"), "{message}");
}

#[test]
fn a_collapsed_joint_still_has_finite_vertices() {
    let mut model = two_bones(Some(0));
    model.rig.as_mut().expect("rig").bones[0].rest_world = Mat4::from_scale(Vec3::new(1.0, 0.0, 1.0));
    let read = Read::new("collapsed", &export(&model, &levels(true), &ExportOptions::default()).expect("exports"));
    assert!(read.floats(&read.attributes(1)["POSITION"], 3).iter().all(|x| x.is_finite()));
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
    let kept = Read::new("kept", &export(&model, &levels(true), &ExportOptions::default()).expect("exports"));
    assert!(read.bin.len() < kept.bin.len());
}

/// [`two_bones`] and its levels, whose one target lifts the last vertex by one.
fn morphing(weight: f32) -> (Model, [Level; 3]) {
    let mut model = two_bones(Some(0));
    let target = MorphTarget { name: "lift".into(), weight, moves: vec![(2, Vec3::Y)] };
    model.surface.morphs = Some(Morphs { node: 3, targets: vec![target] });
    let morph = LevelMorph { positions: vec![Vec3::ZERO, Vec3::ZERO, Vec3::Y], normals: vec![Vec3::ZERO; 3] };
    let levels = levels(true).map(|mut level| {
        level.mesh.morphs = vec![morph.clone()];
        level
    });
    (model, levels)
}

/// Samplers of the channels that weight a node's targets, one clip after the other.
fn weighted_by(read: &Read, node: &Value) -> Vec<Value> {
    let clips = read.json["animations"].as_array().expect("clips").iter();
    let channels = clips.flat_map(|clip| clip["channels"].as_array().expect("channels"));
    let own = channels.filter(|c| c["target"]["node"] == *node && c["target"]["path"] == "weights");
    own.map(|channel| channel["sampler"].clone()).collect()
}

#[test]
fn morphing_levels_are_weighted_like_the_source() {
    let (model, levels) = morphing(0.0);
    for options in [ExportOptions::default(), drop_source()] {
        let name = format!("morphing_{:?}", options.source);
        let read = Read::new(&name, &export(&model, &levels, &options).expect("exports"));
        let nodes = read.json["nodes"].as_array().expect("nodes");
        let meshes = read.json["meshes"].as_array().expect("meshes");
        let is_level = |mesh: &Value| mesh["extras"]["targetNames"] == json!(["lift"]);
        assert_eq!(meshes.iter().filter(|mesh| is_level(mesh)).count(), 3);
        let levels = (0..nodes.len())
            .filter(|&n| nodes[n]["mesh"].as_u64().is_some_and(|mesh| is_level(&meshes[mesh as usize])));
        let levels: Vec<usize> = levels.collect();
        // Each level stands beside the source, and in a scene of its own.
        assert_eq!(levels.len(), 6);
        assert!(levels.iter().all(|n| weighted_by(&read, &json!(n)).len() == 2), "{name}");
        let target = &meshes[meshes.len() - 1]["primitives"][0]["targets"][0];
        // The joints are twice as large as the space the vertices are bound in.
        let lifted = read.floats(&target["POSITION"], 3);
        assert!((lifted.iter().copied().fold(0.0, f32::max) - 0.5).abs() < 1e-6, "{lifted:?}");
        assert_eq!(read.floats(&target["NORMAL"], 3).len(), 9);
    }
}

#[test]
fn a_morphing_level_alone_keeps_its_clips() {
    let (model, levels) = morphing(0.0);
    let read = Read::new("morphing_alone", &export_level(&model, &levels[0]).expect("exports"));
    let node = read.json["nodes"].as_array().expect("nodes").iter().position(|n| n.get("mesh").is_some());
    assert_eq!(weighted_by(&read, &json!(node.expect("a level"))).len(), 2);
}

#[test]
fn default_weights_of_morph_targets_stay_out_of_the_vertices() {
    let highest = |weight: f32| {
        let (model, levels) = morphing(weight);
        let read = Read::new("morphed", &export_level(&model, &levels[0]).expect("exports"));
        assert_eq!(read.json["meshes"][0]["weights"], json!([weight]));
        let positions = read.floats(&read.attributes(0)["POSITION"], 3);
        positions.iter().copied().fold(f32::MIN, f32::max)
    };
    // Half a unit in the space that the joints double.
    assert!((highest(0.0) - highest(1.0) - 0.5).abs() < 1e-6);
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
    let read = Read::new("replaced", &export(&model, &levels(false), &ExportOptions::default()).expect("exports"));
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
fn a_skinned_level_alone_has_skeleton_skin_and_every_clip_in_order() {
    let read = Read::new("level_skinned", &export_level(&two_bones(Some(0)), &level(1000, true)).expect("exports"));
    assert_eq!(read.json["scenes"], json!([{ "name": "main", "nodes": [0, 3] }]));
    let nodes = &read.json["nodes"];
    assert_eq!([&nodes[0]["name"], &nodes[1]["name"], &nodes[2]["name"]], ["root", "upper", "lower"]);
    assert_eq!((&nodes[3]["mesh"], &nodes[3]["skin"]), (&json!(0), &json!(0)));
    assert_eq!(read.json["skins"][0]["joints"], json!([1, 2]));
    assert_eq!([&read.json["animations"][0]["name"], &read.json["animations"][1]["name"]], ["turn", "morph"]);
    assert_eq!((read.len("nodes"), read.len("meshes"), read.len("skins")), (4, 1, 1));
}

#[test]
fn materials_carry_every_mode() {
    let mut level = level(1000, false);
    level.material = LevelMaterial {
        alpha_mode: AlphaMode::Mask { cutoff: 0.3 },
        double_sided: true,
        unlit: true,
        metallic: 0.0,
        roughness: 0.0,
        emissive: Vec3::new(4.0, 2.0, 0.0),
    };
    level.mesh.tangents = vec![Vec3::X.extend(1.0); 3];
    level.textures = all_textures(TextureFormat::Png);
    let read = Read::new("modes", &export_level(&triangle(), &level).expect("exports"));
    let material = &read.json["materials"][0];
    assert_eq!((&material["alphaMode"], &material["alphaCutoff"]), (&json!("MASK"), &json!(0.3)));
    assert_eq!(material["emissiveFactor"], json!([1.0, 0.5, 0.0]));
    assert_eq!(material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"], json!(4.0));
    assert_eq!(material["pbrMetallicRoughness"]["roughnessFactor"], json!(1.0));
    assert_eq!(
        material["occlusionTexture"]["index"],
        material["pbrMetallicRoughness"]["metallicRoughnessTexture"]["index"]
    );
    assert_eq!(read.json["extensionsUsed"], json!(["KHR_materials_emissive_strength", "KHR_materials_unlit"]));
    assert!(read.attributes(0).get("TANGENT").is_some());
    // IHDR of the base colour: colour type 6 is RGBA.
    let view = &read.json["bufferViews"][read.json["images"][0]["bufferView"].as_u64().expect("view") as usize];
    assert_eq!(read.bin[view["byteOffset"].as_u64().unwrap_or(0) as usize + 25], 6);
}

/// An image in each place that has one.
fn all_textures(format: TextureFormat) -> LevelTextures {
    let map = || Some(RgbImage::from_pixel(4, 4, Rgb([128, 128, 255])));
    LevelTextures {
        base_color: base_color(77),
        normal: map(),
        occlusion_roughness_metallic: map(),
        emissive: map(),
        format,
    }
}

#[test]
fn colours_without_alpha_may_be_jpeg_and_nothing_else_is() {
    for (alpha_mode, expected) in [(AlphaMode::Opaque, "image/jpeg"), (AlphaMode::Blend, "image/png")] {
        let mut level = level(1000, false);
        level.material.alpha_mode = alpha_mode;
        level.material.emissive = Vec3::ONE;
        level.mesh.tangents = vec![Vec3::X.extend(1.0); 3];
        level.textures = all_textures(TextureFormat::Jpeg(90));
        let read = Read::new("jpeg", &export_level(&triangle(), &level).expect("exports"));
        let mimes: Vec<&Value> = (0..4).map(|i| &read.json["images"][i]["mimeType"]).collect();
        assert_eq!(mimes, [expected, "image/png", "image/png", "image/jpeg"]);
        for image in read.json["images"].as_array().expect("images") {
            let view = &read.json["bufferViews"][image["bufferView"].as_u64().expect("view") as usize];
            let at = view["byteOffset"].as_u64().unwrap_or(0) as usize;
            let bytes = &read.bin[at..at + view["byteLength"].as_u64().expect("length") as usize];
            let format = image::guess_format(bytes).expect("an image");
            assert_eq!(image["mimeType"], format.to_mime_type());
        }
    }
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
        assert!(export(&two_bones(Some(0)), &[level], &ExportOptions::default()).is_err());
    }
}

#[test]
fn equal_input_gives_equal_bytes() {
    let once = || export(&two_bones(None), &levels(true), &ExportOptions::default()).expect("exports");
    assert_eq!(once(), once());
}
