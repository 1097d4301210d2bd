//! The glTF extensions that are read, that can be left out, and that must be refused.

use serde_json::Value;

use super::asset::Asset;
use crate::Error;

/// Read in full, or without effect on the look of a level.
const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Known, and copied with the source into the output. The levels do without them.
const KEPT_IN_SOURCE: &[&str] = &[
    "CESIUM_primitive_outline",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_features",
    "EXT_structural_metadata",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_variants",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_node_visibility",
    "KHR_physics_rigid_bodies",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_lod",
];

/// Refuses a file that requires an extension which is not understood.
pub(super) fn check_required(asset: Asset<'_>, required: &[&str]) -> Result<(), Error> {
    match required.iter().find(|name| !READ.contains(name) && !KEPT_IN_SOURCE.contains(name)) {
        Some(name) => Err(refuse(asset, name)),
        None => Ok(()),
    }
}

/// The error for an extension that cannot be decoded.
pub(super) fn refuse(asset: Asset<'_>, name: &str) -> Error {
    let advice = match name {
        "MSFT_texture_dds" | "EXT_texture_avif" => {
            "convert its textures with 'gltf-transform png in.glb out.glb'".to_owned()
        }
        _ => "export it without that extension; 'gltf-transform inspect in.glb' shows what uses it".to_owned(),
    };
    Error::Extension { asset: asset.name.to_owned(), extension: name.to_owned(), advice }
}

/// Removes `names` from a list of declared extensions, and the list if it is empty then.
pub(super) fn undeclare(json: &mut Value, list: &str, names: &[&str]) {
    let Some(root) = json.as_object_mut() else { return };
    let Some(declared) = root.get_mut(list).and_then(Value::as_array_mut) else { return };
    declared.retain(|name| !name.as_str().is_some_and(|name| names.contains(&name)));
    if declared.is_empty() {
        root.remove(list);
    }
}

/// Removes the extensions `names` from an object; returns the first that it had.
pub(super) fn take(object: &mut Value, names: &[&str]) -> Option<Value> {
    let object = object.as_object_mut()?;
    let extensions = object.get_mut("extensions")?.as_object_mut()?;
    let taken: Vec<Value> = names.iter().filter_map(|name| extensions.remove(*name)).collect();
    if extensions.is_empty() {
        object.remove("extensions");
    }
    taken.into_iter().next()
}

/// Notes for the report: extensions of the used materials that change their look, and that the levels do without.
pub(super) fn dropped_material_extensions(json: &Value, materials: &[usize]) -> Vec<String> {
    let mut names: Vec<&str> = materials
        .iter()
        .filter_map(|&index| json.get("materials")?.get(index)?.get("extensions")?.as_object())
        .flat_map(|extensions| extensions.keys().map(String::as_str))
        .filter(|name| !READ.contains(name))
        .collect();
    names.sort_unstable();
    names.dedup();
    names.into_iter().map(|name| format!("the material extension {name} is left out of the levels")).collect()
}
