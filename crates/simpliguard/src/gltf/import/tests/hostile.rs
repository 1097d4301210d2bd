use bytes::Bytes;
use proptest::prelude::*;
use serde_json::json;

use super::assert_sound;
use super::builder::{Builder, F32, U16, U32, import_bytes, png_with_side};
use crate::gltf::{ImportLimits, import};
use crate::{Error, RelativeUri, Resources, Source};

/// A folder that holds the one file `image.png`, which is no image.
struct Garbage;

impl Resources for Garbage {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        if uri.as_str() == "image.png" { Ok(Bytes::from_static(b"garbage")) } else { Err("no such file".into()) }
    }
}

fn with_image(image: serde_json::Value) -> Builder {
    let mut file = Builder::triangle();
    file.attribute("TEXCOORD_0", F32, "VEC2", &[[0.0f32, 0.0]; 3]);
    file.push("images", image);
    file.push("textures", json!({"source": 0}));
    file.material(json!({"emissiveTexture": {"index": 0}}));
    file
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "'{part}' is not in: {message}");
    }
}

#[test]
fn uris_that_leave_the_folder_are_refused_by_name() {
    for (uri, rule) in [("../secret.png", "'..'"), ("http://x.org/a.png", "scheme"), ("%2Fetc/passwd", "absolute")] {
        assert_says(&with_image(json!({"uri": uri})).message(), &["test.glb", "import", uri, rule]);
        let mut file = Builder::triangle();
        file.json["buffers"] = json!([{"byteLength": 36, "uri": uri}]);
        assert_says(&file.message(), &[uri, rule]);
    }
}

#[test]
fn a_texture_that_cannot_be_had_or_decoded_is_named() {
    for (uri, reason) in [("gone.png", "no such file"), ("image.png", "no PNG")] {
        let bytes = with_image(json!({"uri": uri})).glb();
        let source = Source { name: "model.glb", bytes: &bytes, resources: &Garbage };
        let error = import(&source, &ImportLimits::default()).expect_err("an error");
        assert!(matches!(error, Error::Resource { .. }), "{error}");
        assert_says(&error.to_string(), &["model.glb", uri, reason]);
    }
}

#[test]
fn a_huge_image_is_refused_by_its_header() {
    for (side, over) in [(16_384u32, 0), (16_385, 16_384), (40_000, 16_384)] {
        let mut file = with_image(json!({}));
        let view = file.view(&png_with_side(side));
        file.json["images"][0] = json!({"bufferView": view});
        // Its header alone is read: the pixels of the smallest one are missing.
        let found = if over == 0 { "image 0".to_owned() } else { format!("{side}, over the limit of {over}") };
        assert_says(&file.message(), &["test.glb", "image 0", &found]);
    }
}

#[test]
fn cycles_and_second_parents_are_refused() {
    let mut file = Builder::triangle();
    file.json["nodes"] = json!([{"children": [1]}, {"children": [0]}]);
    assert_says(&file.message(), &["node 0", "cycle"]);
    file.json["nodes"] = json!([{"children": [1, 2]}, {"children": [2]}, {"mesh": 0}]);
    assert_says(&file.message(), &["node 2", "two parents"]);
}

#[test]
fn limits_hold_before_anything_is_allocated() {
    let limits = ImportLimits { nodes: 4, depth: 2, triangles: 100, ..ImportLimits::default() };
    let limited = |file: &Builder, what: &str| {
        let error = file.import_within(&limits).expect_err("an error");
        assert!(matches!(error, Error::Limit { .. }), "{error}");
        assert_says(&error.to_string(), &[what]);
    };
    let mut file = Builder::triangle();
    file.json["nodes"] = json!([{"children": [1]}, {"children": [2]}, {"mesh": 0}]);
    limited(&file, "depth");
    file.json["nodes"] = json!([{}, {}, {}, {}, {}]);
    limited(&file, "number of nodes");

    let mut instanced = Builder::triangle();
    let many = instanced.push("accessors", json!({"componentType": F32, "type": "VEC3", "count": 101}));
    let extension = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": many}}});
    instanced.json["nodes"][0]["extensions"] = extension;
    limited(&instanced, "number of triangles");

    let mut virtual_vertices = Builder::triangle();
    virtual_vertices.json["accessors"][0] = json!({"componentType": F32, "type": "VEC3", "count": 1u64 << 60});
    limited(&virtual_vertices, "element count");

    let small = ImportLimits { bytes: 100, ..ImportLimits::default() };
    assert!(matches!(Builder::triangle().import_within(&small), Err(Error::Limit { .. })));
    let few = ImportLimits { json_values: 3, ..ImportLimits::default() };
    assert!(matches!(Builder::triangle().import_within(&few), Err(Error::Limit { .. })));
}

#[test]
fn deep_json_is_refused() {
    let text =
        format!("{{\"asset\":{{\"version\":\"2.0\"}},\"extras\":{}1{}}}", "[".repeat(10_000), "]".repeat(10_000));
    assert_says(
        &import_bytes(text.as_bytes(), &ImportLimits::default()).expect_err("an error").to_string(),
        &["recursion"],
    );
}

#[test]
fn json_that_would_take_much_memory_is_refused_before_it_is_parsed() {
    // Each pair of brackets takes hundreds of bytes once it is parsed.
    for (open, close) in [("{\"\":", "}"), ("[", "]")] {
        let nested = format!("{}1{}", open.repeat(100), close.repeat(100));
        let text = format!("{{\"extras\":[{}1]}}", format!("{nested},").repeat(30_000_000 / nested.len()));
        let error = import_bytes(text.as_bytes(), &ImportLimits::default()).expect_err("an error");
        assert_says(&error.to_string(), &["test.glb", "memory in bytes of the parsed JSON", "over the limit"]);
    }
}

#[test]
fn extents_past_their_bytes_are_refused() {
    let message = |edit: &dyn Fn(&mut Builder)| {
        let mut file = Builder::triangle();
        edit(&mut file);
        file.message()
    };
    assert_says(&message(&|file| file.json["accessors"][0]["count"] = json!(4)), &["accessor 0", "4 elements"]);
    assert_says(&message(&|file| file.json["bufferViews"][0]["byteLength"] = json!(99)), &["buffer view 0"]);
    assert_says(&message(&|file| file.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX)), &["buffer view 0"]);
    assert_says(&message(&|file| file.json["bufferViews"][0]["byteStride"] = json!(4)), &["byteStride"]);
    assert_says(&message(&|file| file.json["bufferViews"][0]["buffer"] = json!(9)), &["buffer 9"]);
    assert_says(&message(&|file| file.json["accessors"][0]["type"] = json!("MAT3")), &["MAT3"]);
    assert_says(&message(&|file| file.json["accessors"][0]["componentType"] = json!(1)), &["component type 1"]);
    assert_says(&message(&|file| file.primitive()["material"] = json!(3)), &["material 3"]);
    assert_says(&message(&|file| file.json["nodes"][0]["mesh"] = json!("zero")), &["nodes[0].mesh"]);
    let index_past_the_vertices = |file: &mut Builder| {
        let indices = file.accessor(U16, "SCALAR", &[0u16, 1, 3]);
        file.primitive()["indices"] = json!(indices);
    };
    assert_says(&message(&index_past_the_vertices), &["vertex 3"]);
    let signed_indices = |file: &mut Builder| file.primitive()["indices"] = json!(0);
    assert_says(&message(&signed_indices), &["unsigned"]);
}

#[test]
fn required_extensions_that_are_not_understood_are_named_with_their_cure() {
    let refusal = |name: &str| {
        let mut file = Builder::triangle();
        file.json["extensionsRequired"] = json!([name]);
        file.message()
    };
    assert_says(&refusal("EXT_texture_avif"), &["EXT_texture_avif", "gltf-transform png"]);
    assert_says(&refusal("ACME_splines"), &["ACME_splines"]);
}

#[test]
fn other_files_are_told_from_gltf() {
    for (bytes, part) in [
        (&b""[..], "empty"),
        (b"solid cube", "neither"),
        (b"{}", "asset"),
        (b"{\"asset\":{\"version\":\"1.0\"}}", "glTF 1.0"),
        (b"{\"asset\":{\"version\":\"2.0\"}", "JSON is broken"),
        (b"glTF\x02\0\0\0\x20\0\0\0", "truncated"),
    ] {
        assert_says(&import_bytes(bytes, &ImportLimits::default()).expect_err("an error").to_string(), &[part]);
    }
}

#[test]
fn whole_numbers_written_as_floats_are_indices_too() {
    let mut file = Builder::triangle();
    file.json["nodes"][0]["mesh"] = json!(0.0);
    assert_eq!(file.model().document.json["nodes"][0]["mesh"].as_u64(), Some(0));
}

/// A small file that uses most of what is read.
fn rich() -> Vec<u8> {
    let mut file = Builder::triangle();
    file.attribute("TEXCOORD_0", F32, "VEC2", &[[0.0f32, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    file.attribute("JOINTS_0", U16, "VEC4", &[[0u16, 1, 0, 0]; 3]);
    file.attribute("WEIGHTS_0", F32, "VEC4", &[[0.5f32, 0.5, 0.0, 0.0]; 3]);
    let indices = file.accessor(U32, "SCALAR", &[0u32, 1, 2]);
    file.primitive()["indices"] = json!(indices);
    file.json["nodes"][0]["skin"] = json!(0);
    file.root(json!({"children": [2], "rotation": [0, 0, 0, 1]}));
    file.push("nodes", json!({"translation": [0, 1, 0]}));
    file.push("skins", json!({"joints": [1, 2]}));
    let texture = file.texture([9, 8, 7, 255]);
    file.material(json!({"normalTexture": {"index": texture, "scale": 2}}));
    file.glb()
}

#[test]
fn the_file_that_is_broken_below_is_sound() {
    assert_sound(&import_bytes(&rich(), &ImportLimits::default()).expect("a sound file"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn truncated_files_give_an_error(part in 0.0..1.0f64) {
        let bytes = rich();
        let length = (bytes.len() as f64 * part) as usize;
        prop_assert!(import_bytes(&bytes[..length], &ImportLimits::default()).is_err());
    }

    #[test]
    fn changed_bytes_give_an_error_or_a_sound_model(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let mut bytes = rich();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Ok(model) = import_bytes(&bytes, &ImportLimits::default()) {
            assert_sound(&model);
        }
    }
}
