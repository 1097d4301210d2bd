use image::{Rgba, RgbaImage};
use serde_json::{Value, json};

use super::Divided;
use crate::gltf::glb::{binary, split};
use crate::gltf::png::png;

/// The side of the images of source and level.
const SIDE: u32 = 256;

/// A file whose node 0 has a square of two triangles, with a level of one. Node 1 shows a mesh of its own.
fn whole(edit: impl FnOnce(&mut Value)) -> Vec<u8> {
    let corners: [f32; 12] = [0.0, 0.0, 1.0, 2.0, 0.0, 1.0, 2.0, 2.0, 1.0, 0.0, 2.0, 1.0];
    let picture =
        |red| png(&RgbaImage::from_fn(SIDE, SIDE, |x, y| Rgba([red, x as u8, y as u8, 255]))).expect("writes");
    let parts = [
        corners.into_iter().flat_map(f32::to_le_bytes).collect(),
        [0_u16, 1, 2, 0, 2, 3].into_iter().flat_map(u16::to_le_bytes).collect(),
        picture(1),
        picture(2),
    ];
    let (mut buffer, mut views) = (Vec::new(), Vec::new());
    for bytes in parts {
        buffer.resize(buffer.len().next_multiple_of(4), 0);
        views.push(json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": bytes.len() }));
        buffer.extend_from_slice(&bytes);
    }
    let mesh = |position: usize, material: usize| {
        let targets = [json!({ "POSITION": position })];
        json!({ "primitives": [
            { "attributes": { "POSITION": position }, "indices": 2, "material": material, "targets": targets },
        ] })
    };
    let position = |count: usize| {
        json!({
            "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 1], "max": [2, 2, 1],
        })
    };
    let indices = json!({ "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" });
    let image = |view: usize| json!({ "bufferView": view, "mimeType": "image/png" });
    let material = |texture: usize| json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } });
    let mut document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1] }, { "nodes": [2] }],
        "nodes": [
            { "mesh": 0, "extensions": { "MSFT_lod": { "ids": [2] } } },
            { "mesh": 2 },
            { "mesh": 1, "extras": { "simpliguard": { "level": 1, "replaces": [0] } } },
        ],
        "meshes": [mesh(0, 0), mesh(1, 1), mesh(1, 1)],
        "accessors": [position(4), position(3), indices],
        "materials": [material(0), material(1)],
        "textures": [{ "source": 0 }, { "source": 1 }],
        "images": [image(2), image(3)],
        "animations": [],
        "bufferViews": views,
        "buffers": [{ "byteLength": buffer.len() }],
        "extensionsUsed": ["MSFT_lod"],
    });
    edit(&mut document);
    binary(&document, &buffer).expect("a small file")
}

fn divide(edit: impl FnOnce(&mut Value)) -> Option<Divided> {
    super::divide("square.glb", &whole(edit)).expect("a binary glTF")
}

/// The JSON of a file, and the bytes of what a view of it shows.
struct Read(Value, Vec<u8>);

impl Read {
    fn new(glb: &[u8]) -> Self {
        gltf_is_valid(glb);
        let chunks = split(glb).expect("a binary glTF");
        Self(serde_json::from_slice(chunks.json).expect("JSON"), chunks.bin.expect("a buffer").to_vec())
    }

    fn view(&self, object: &Value) -> &[u8] {
        let number = |value: &Value| value.as_u64().expect("a number") as usize;
        let view = &self.0["bufferViews"][number(&object["bufferView"])];
        let start = number(&view["byteOffset"]);
        &self.1[start..start + number(&view["byteLength"])]
    }

    fn side(&self, image: usize) -> u32 {
        image::load_from_memory(self.view(&self.0["images"][image])).expect("a PNG").width()
    }

    fn position(&self, mesh: usize) -> &Value {
        let accessor = &self.0["meshes"][mesh]["primitives"][0]["attributes"]["POSITION"];
        &self.0["accessors"][accessor.as_u64().expect("a number") as usize]
    }
}

/// Every view lies within the buffer.
fn gltf_is_valid(glb: &[u8]) {
    let chunks = split(glb).expect("a binary glTF");
    let json: Value = serde_json::from_slice(chunks.json).expect("JSON");
    for view in json["bufferViews"].as_array().expect("views") {
        let end = view["byteOffset"].as_u64().unwrap_or(0) + view["byteLength"].as_u64().expect("a length");
        assert!(end <= chunks.bin.map_or(0, <[u8]>::len) as u64, "{view}");
    }
}

#[test]
fn the_levels_have_a_placeholder_of_the_source_in_its_place() {
    let divided = divide(|_| {}).expect("two parts");
    let (before, levels) = (Read::new(&whole(|_| {})), Read::new(&divided.levels));
    for key in ["nodes", "scenes", "materials", "textures"] {
        assert_eq!(before.0[key], levels.0[key], "{key}");
    }
    let mesh = levels.position(0);
    assert_eq!((&mesh["count"], &mesh["min"], &mesh["max"]), (&json!(3), &json!([0, 0, 1]), &json!([2, 2, 1])));
    let corners: Vec<f32> =
        levels.view(mesh).as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    assert_eq!(corners, [0.0, 0.0, 1.0, 2.0, 2.0, 1.0, 0.0, 0.0, 1.0]);
    assert_eq!(levels.0["meshes"][0]["primitives"][0]["targets"].as_array().map(Vec::len), Some(1));
    assert!([1, 2].iter().all(|&mesh| levels.view(levels.position(mesh)).len() == 3 * 12));
    assert_eq!([0, 1].map(|image| levels.side(image)), [1, SIDE]);
    let stamp = &levels.0["asset"]["extras"]["simpliguard"];
    assert_eq!((divided.parts.len(), &stamp["levels"]), (1, &json!([])), "its only level is the smallest");
    let stamp = &stamp["source"];
    assert_eq!((&stamp["meshes"], &stamp["textures"]), (&json!([0]), &json!([0])));
    assert_eq!(stamp["faces"], json!([[1]]));
    assert_eq!(stamp["file"], json!(divided.parts[0].name));
    // Texels with mipmaps, four vertices with normals and a target, and their indices: flat, so three corners.
    assert_eq!(stamp["bytes"], json!(4 * (4_u64.pow(9) - 1) / 3 + 3 * (24 + 48)));
}

#[test]
fn the_source_has_all_of_itself_and_nothing_to_spawn() {
    let divided = divide(|_| {}).expect("two parts");
    let (before, source) = (Read::new(&whole(|_| {})), Read::new(&divided.parts[0].bytes));
    assert!(["scenes", "scene", "animations"].iter().all(|key| source.0.get(key).is_none()));
    assert_eq!(source.view(source.position(0)), before.view(before.position(0)));
    assert_eq!(source.view(&source.0["images"][0]), before.view(&before.0["images"][0]));
    assert_eq!((source.position(1)["count"].clone(), source.side(1)), (json!(3), 1));
    assert_eq!(source.0["asset"]["extras"]["simpliguard"], json!({ "part": "source" }));
    assert!(divided.parts[0].bytes.len() + divided.levels.len() < whole(|_| {}).len() + 8000);
}

#[test]
fn equal_files_are_divided_alike_and_others_have_another_name() {
    let [a, b] = [divide(|_| {}), divide(|_| {})];
    assert_eq!(a, b);
    let other = divide(|json| json["materials"][0]["name"] = json!("paint")).expect("two parts");
    assert_ne!(a.expect("two parts").parts[0].name, other.parts[0].name);
}

/// Makes the second node a level with a picture of its own, and more detailed than the other.
fn with_two_levels(json: &mut Value) {
    json["nodes"][1]["extras"] = json!({ "simpliguard": { "level": 2, "replaces": [0] } });
    json["scenes"][0]["nodes"] = json!([0]);
    json["meshes"][2]["primitives"][0]["material"] = json!(2);
    for (key, like) in [("materials", 1), ("textures", 1), ("images", 1)] {
        let copy = json[key][like].clone();
        json[key].as_array_mut().expect("objects").push(copy);
    }
    json["materials"][2]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = json!(2);
    json["textures"][2]["source"] = json!(2);
}

#[test]
fn detailed_levels_are_parts_of_their_own() {
    let divided = divide(with_two_levels).expect("three parts");
    let levels = Read::new(&divided.levels);
    assert_eq!([0, 1, 2].map(|image| levels.side(image)), [1, SIDE, 1], "the smallest level has its picture");
    let stamp = &levels.0["asset"]["extras"]["simpliguard"]["levels"];
    let expected = json!([{
        "level": 2, "file": divided.parts[1].name, "bytes": stamp[0]["bytes"], "meshes": [2], "faces": [[1]],
        "textures": [2],
    }]);
    assert_eq!(stamp, &expected);
    let [source, level] = &divided.parts[..] else { panic!("two parts") };
    let version = source.name.strip_suffix(".glb").expect("a binary glTF");
    assert_eq!(level.name, format!("{version}_LOD2.glb"));
    let level = Read::new(&level.bytes);
    assert_eq!([0, 1, 2].map(|image| level.side(image)), [1, 1, SIDE]);
    let before = Read::new(&whole(with_two_levels));
    assert_eq!(level.view(level.position(2)), &before.view(before.position(2))[..3 * 12]);
    assert_eq!(level.0["asset"]["extras"]["simpliguard"], json!({ "part": "level" }));
}

#[test]
fn a_level_that_is_also_shown_alone_is_a_part() {
    let alone = |scene: usize| {
        divide(|json| {
            with_two_levels(json);
            json["nodes"].as_array_mut().expect("nodes").push(json!({ "mesh": 2 }));
            json["scenes"][scene]["nodes"].as_array_mut().expect("nodes").push(json!(3));
        })
    };
    assert_eq!(alone(1).map(|divided| divided.parts.len()), Some(2));
    assert_eq!(alone(0).map(|divided| divided.parts.len()), Some(1), "beside the source, it is something else");
}

#[test]
fn each_object_keeps_its_smallest_level() {
    // The only level of the second object is more detailed than the smallest of the first.
    let divided = divide(|json| {
        with_two_levels(json);
        json["nodes"][1]["extras"]["simpliguard"]["object"] = json!(0);
    });
    let stamp = Read::new(&divided.expect("a source").levels).0["asset"]["extras"]["simpliguard"].clone();
    assert_eq!(stamp["levels"], json!([]));
}

#[test]
fn what_others_show_stays_with_the_levels() {
    let divided = divide(|json| json["meshes"][1]["primitives"][0]["material"] = json!(0)).expect("two parts");
    assert_eq!(Read::new(&divided.levels).side(0), SIDE);
    assert_eq!(divide(|json| json["nodes"][1]["mesh"] = json!(0)), None, "the mesh of another node");
}

#[test]
fn files_that_cannot_be_divided_stay_whole() {
    assert_eq!(divide(|json| json["nodes"][2]["extras"] = json!({})), None, "no levels");
    let of_all = json!({ "simpliguard": { "level": 1, "replaces": [0], "whole": true } });
    assert_eq!(divide(|json| json["nodes"][2]["extras"] = of_all), None, "levels of other levels");
    let two = json!({ "simpliguard": { "level": 1, "replaces": [0, 1] } });
    let half = |json: &mut Value| {
        json["nodes"][2]["extras"] = two;
        json["scenes"][1]["nodes"] = json!([1]);
    };
    assert_eq!(divide(half), None, "a scene with a part of the source");
    let encoded = json!({ "KHR_draco_mesh_compression": {} });
    assert_eq!(divide(|json| json["meshes"][0]["primitives"][0]["extensions"] = encoded), None, "an encoded mesh");
    assert_eq!(divide(|json| json["meshes"][0]["primitives"][0]["mode"] = json!(1)), None, "lines");
    assert_eq!(divide(|json| json["asset"]["extras"] = json!(7)), None, "no place for the name of the source");
    assert!(super::divide("no.glb", b"no glTF").is_err());
}
