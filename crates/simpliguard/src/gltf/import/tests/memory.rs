//! The budget of memory: what is not in the file cannot be asked for either.

use serde_json::json;

use super::builder::{Builder, import_bytes};
use crate::Error;
use crate::gltf::ImportLimits;

/// The message of an import with 64 MiB.
fn refusal(file: Builder) -> String {
    let limits = ImportLimits { memory: 64 << 20, ..ImportLimits::default() };
    let error = import_bytes(&file.glb(), &limits).expect_err("too large");
    assert!(matches!(error, Error::Memory { .. }), "{error}");
    error.to_string()
}

#[test]
fn accessors_without_bytes_are_counted() {
    let mut file = Builder::triangle();
    file.push("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 3_000_000}));
    file.json["meshes"][0]["primitives"][0] = json!({"attributes": {"POSITION": 1}});
    let text = refusal(file);
    assert!(text.starts_with("test.glb: import: its surface would take "), "{text}");
    assert!(
        text.ends_with(
            " of memory, and a bake may take 64.0 MiB; reduce it, or give more with `--memory` or \
             `SimpliguardPlugin::memory`"
        ),
        "{text}"
    );
}

#[test]
fn instances_are_counted() {
    let mut file = Builder::triangle();
    file.push("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 1_000_000}));
    let instancing = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}});
    file.json["nodes"][0]["extensions"] = instancing;
    assert!(refusal(file).contains("its surface would take"));
}

#[test]
fn sets_of_joints_and_morph_targets_are_counted() {
    let many = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut file = Builder::triangle();
        file.push("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 3000}));
        let primitive = &mut file.json["meshes"][0]["primitives"][0];
        *primitive = json!({"attributes": {"POSITION": 1}});
        change(primitive);
        refusal(file)
    };
    let sets = many(&|primitive| {
        for set in 0..1000 {
            primitive["attributes"][format!("JOINTS_{set}")] = json!(1);
        }
    });
    let targets = many(&|primitive| primitive["targets"] = json!(vec![json!({"POSITION": 1}); 1000]));
    assert!(
        sets.contains("its surface would take 9") && targets.contains("its surface would take 8"),
        "{sets} {targets}"
    );
}

#[test]
fn images_of_one_colour_are_counted() {
    let mut file = Builder::triangle();
    file.attribute("TEXCOORD_0", super::builder::F32, "VEC2", &[[0.0f32, 0.0]; 3]);
    let view = file.view(&super::builder::png_with_side(4096));
    file.push("images", json!({"bufferView": view}));
    file.push("textures", json!({"source": 0}));
    file.material(json!({"emissiveTexture": {"index": 0}}));
    assert!(refusal(file).contains("its textures would take 85.3 MiB of memory"));
}
