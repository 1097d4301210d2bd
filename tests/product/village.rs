//! The scene of the example `village`: 300 objects of 20 meshes.

#[path = "../../examples/village/scene.rs"]
#[expect(dead_code, reason = "of the example's two files, one is used here")]
mod scene;
#[path = "../../examples/village/shapes.rs"]
mod shapes;

use std::borrow::Cow;
use std::fs;
use std::path::Path;

use scene::LevelsOf;
pub(crate) use scene::RADIUS;
use serde_json::Value;

/// The name of the file.
pub(crate) const FILE: &str = LevelsOf::Objects.file();

/// Writes the file with its settings into a folder; returns its bytes.
pub(crate) fn write(folder: &Path) -> Vec<u8> {
    scene::write(folder, LevelsOf::Objects).expect("writes");
    fs::read(folder.join(FILE)).expect("was written")
}

/// The file with one object at another place.
pub(crate) fn with_moved_object(glb: &[u8]) -> Vec<u8> {
    let mut glb = gltf::Glb::from_slice(glb).expect("valid");
    let mut json: Value = serde_json::from_slice(&glb.json).expect("JSON");
    json["nodes"][0]["translation"][1] = serde_json::json!(0.5);
    glb.json = Cow::Owned(serde_json::to_vec(&json).expect("JSON"));
    glb.to_vec().expect("writes")
}

/// The file with another shape of one mesh.
pub(crate) fn with_changed_mesh(glb: &[u8]) -> Vec<u8> {
    let mut glb = gltf::Glb::from_slice(glb).expect("valid");
    let bin = glb.bin.as_mut().expect("a buffer").to_mut();
    let x = f32::from_le_bytes(bin[..4].try_into().expect("four bytes"));
    bin[..4].copy_from_slice(&(0.9 * x).to_le_bytes());
    glb.to_vec().expect("writes")
}
