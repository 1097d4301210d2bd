//! The material of a level as glTF.

use glam::Vec4;
use serde_json::{Map, Value, json};

use super::builder::{Builder, Kind, number};
use super::textures::WrittenTextures;
use crate::data::{AlphaMode, LevelMaterial, Transmission};

/// Appends the material of a level; returns its index.
pub(in crate::gltf) fn push_material(
    out: &mut Builder,
    name: &str,
    source: &LevelMaterial,
    textures: &WrittenTextures,
) -> usize {
    let mut material = reflection(name, source, textures);
    if let Some(index) = textures.normal {
        material["normalTexture"] = json!({ "index": index });
    }
    if source.double_sided {
        material["doubleSided"] = json!(true);
    }
    match source.alpha_mode {
        AlphaMode::Opaque => {}
        AlphaMode::Mask { cutoff } => {
            material["alphaMode"] = json!("MASK");
            material["alphaCutoff"] = number(cutoff);
        }
        AlphaMode::Blend => material["alphaMode"] = json!("BLEND"),
    }
    let mut extensions = Map::new();
    if source.unlit {
        extensions.insert("KHR_materials_unlit".into(), json!({}));
    }
    if let Some(transmission) = &source.transmission {
        add_transmission(&mut extensions, transmission);
    }
    add_emission(&mut material, &mut extensions, source, textures.emissive);
    if !extensions.is_empty() {
        extensions.keys().for_each(|name| out.use_extension(name));
        material["extensions"] = Value::Object(extensions);
    }
    out.push(Kind::Material, material)
}

/// A material with base colour, roughness, metalness and occlusion.
fn reflection(name: &str, source: &LevelMaterial, textures: &WrittenTextures) -> Value {
    let packed = textures.occlusion_roughness_metallic;
    let (metallic, roughness) = if packed.is_some() { (1.0, 1.0) } else { (source.metallic, source.roughness) };
    let mut material = json!({
        "name": name,
        "pbrMetallicRoughness": {
            "metallicFactor": number(metallic),
            "roughnessFactor": number(roughness),
        },
    });
    if let Some(index) = textures.base_color {
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": index });
    }
    if source.base_color != Vec4::ONE {
        let factor = source.base_color.clamp(Vec4::ZERO, Vec4::ONE).to_array().map(number).into_iter().collect();
        material["pbrMetallicRoughness"]["baseColorFactor"] = factor;
    }
    if let Some(index) = packed {
        material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({ "index": index });
        material["occlusionTexture"] = json!({ "index": index });
    }
    material
}

/// Adds emission to a material. Emission above one takes `KHR_materials_emissive_strength`, since factors end at one.
fn add_emission(
    material: &mut Value,
    extensions: &mut Map<String, Value>,
    source: &LevelMaterial,
    texture: Option<usize>,
) {
    let strongest = source.emissive.max_element();
    if strongest <= 0.0 || strongest.is_nan() {
        return;
    }
    let strength = strongest.max(1.0);
    material["emissiveFactor"] = (source.emissive / strength).to_array().map(number).into_iter().collect();
    if strength > 1.0 {
        let strength = json!({ "emissiveStrength": number(strength) });
        extensions.insert("KHR_materials_emissive_strength".into(), strength);
    }
    if let Some(index) = texture {
        material["emissiveTexture"] = json!({ "index": index });
    }
}

/// Adds the light that passes through a material.
fn add_transmission(extensions: &mut Map<String, Value>, transmission: &Transmission) {
    let Transmission { factor, ior, thickness, attenuation_distance, attenuation_color } = *transmission;
    let mut add = |name: &str, value| extensions.insert(format!("KHR_materials_{name}"), value);
    add("transmission", json!({ "transmissionFactor": number(factor) }));
    add("ior", json!({ "ior": number(ior) }));
    if thickness > 0.0 {
        let mut volume = json!({ "thicknessFactor": number(thickness) });
        if attenuation_distance.is_finite() {
            volume["attenuationDistance"] = number(attenuation_distance);
            volume["attenuationColor"] = attenuation_color.to_array().map(number).into_iter().collect();
        }
        add("volume", volume);
    }
}
