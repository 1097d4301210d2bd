use glam::{Vec2, Vec3, Vec4};
use serde_json::{Value, json};

use super::builder::{Builder, F32, png};
use crate::data::{AlphaMode, Material, Model};

fn material(value: Value) -> Material {
    let mut file = Builder::triangle();
    file.material(value);
    file.model().materials.remove(0)
}

/// A model whose only material has a base colour texture with these properties.
fn textured(info: Value) -> (Builder, usize) {
    let mut file = Builder::triangle();
    file.attribute("TEXCOORD_0", F32, "VEC2", &[[0.0f32, 0.0]; 3]);
    file.attribute("TEXCOORD_1", F32, "VEC2", &[[1.0f32, 1.0]; 3]);
    let texture = file.texture([255, 128, 0, 255]);
    let mut info = info;
    info["index"] = json!(texture);
    file.material(json!({"pbrMetallicRoughness": {"baseColorTexture": info}}));
    (file, texture)
}

fn base_color(model: &Model) -> crate::data::TextureRef {
    model.materials[0].base_color_texture.expect("a texture")
}

#[test]
fn metallic_roughness_factors_and_modes_arrive() {
    let found = material(json!({
        "name": "paint",
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1, 0.5], "metallicFactor": 0, "roughnessFactor": 0.5},
        "emissiveFactor": [1, 0.5, 0], "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}, "KHR_materials_unlit": {}},
    }));
    let expected = Material {
        name: "paint".into(),
        base_color: Vec4::new(0.5, 0.25, 1.0, 0.5),
        metallic: 0.0,
        roughness: 0.5,
        emissive: Vec3::new(4.0, 2.0, 0.0),
        alpha_mode: AlphaMode::Mask { cutoff: 0.25 },
        double_sided: true,
        unlit: true,
        index: Some(0),
        ..Material::default()
    };
    assert_eq!(found, expected);
}

#[test]
fn faces_without_a_material_get_the_default_one() {
    assert_eq!(Builder::triangle().model().materials, [Material::default()]);
}

#[test]
fn specular_glossiness_becomes_a_dielectric_of_the_diffuse_colour() {
    let extension = json!({"diffuseFactor": [0.25, 0.5, 0.75, 1], "glossinessFactor": 0.75});
    let found = material(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": extension}}));
    assert_eq!((found.base_color, found.metallic, found.roughness), (Vec4::new(0.25, 0.5, 0.75, 1.0), 0.0, 0.25));
}

#[test]
fn extensions_that_the_levels_do_without_are_noted() {
    let mut file = Builder::triangle();
    file.material(json!({"extensions": {"KHR_materials_sheen": {}, "KHR_materials_unlit": {}}}));
    assert_eq!(file.model().notes, ["the material extension KHR_materials_sheen is left out of the levels"]);
}

#[test]
fn a_texture_transform_scales_rotates_and_moves_and_may_name_the_set() {
    let transform =
        json!({"offset": [0.5, 0], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2, 1], "texCoord": 1});
    let (file, _) = textured(json!({"extensions": {"KHR_texture_transform": transform}}));
    let model = file.model();
    let texture = base_color(&model);
    assert_eq!(texture.uv_set, 1);
    assert!(texture.transform.transform_point2(Vec2::X).abs_diff_eq(Vec2::new(0.5, -2.0), 1e-6));
    assert!(texture.transform.transform_point2(Vec2::Y).abs_diff_eq(Vec2::new(1.5, 0.0), 1e-6));
    assert_eq!(model.surface.uvs[1], [Vec2::ONE; 3]);
}

#[test]
fn the_third_set_of_texture_coordinates_takes_a_free_place() {
    let (mut file, _) = textured(json!({"texCoord": 2}));
    file.attribute("TEXCOORD_2", F32, "VEC2", &[[0.5f32, 0.5]; 3]);
    let model = file.model();
    assert_eq!(base_color(&model).uv_set, 0);
    assert_eq!(model.surface.uvs[0], [Vec2::splat(0.5); 3]);
}

#[test]
fn one_image_in_two_colour_spaces_is_two_textures() {
    let (mut file, texture) = textured(json!({}));
    file.json["materials"][0]["emissiveTexture"] = json!({"index": texture});
    file.json["materials"][0]["occlusionTexture"] = json!({"index": texture, "strength": 0.5});
    let model = file.model();
    let material = &model.materials[0];
    assert_eq!((model.textures.len(), material.occlusion_strength), (2, 0.5));
    assert_eq!(material.emissive_texture, material.base_color_texture);
    let green = |slot: Option<crate::data::TextureRef>| {
        model.textures[slot.expect("a texture").texture].sample(Vec2::splat(0.5), 0.0).y
    };
    assert!((green(material.occlusion_texture) - 128.0 / 255.0).abs() < 1e-6);
    assert!((green(material.base_color_texture) - 0.2158605).abs() < 1e-6);
}

#[test]
fn wrap_modes_come_from_the_sampler_and_default_to_repeat() {
    let texels = image::RgbaImage::from_raw(2, 1, vec![0, 0, 0, 255, 255, 255, 255, 255]).expect("2x1");
    let mut encoded = std::io::Cursor::new(Vec::new());
    texels.write_to(&mut encoded, image::ImageFormat::Png).expect("a PNG");
    for (wrap, past_the_border) in [(None, 0.0), (Some(10497), 0.0), (Some(33071), 1.0), (Some(33648), 1.0)] {
        let (mut file, texture) = textured(json!({}));
        let view = file.view(encoded.get_ref());
        file.json["images"] = json!([{"bufferView": view}]);
        if let Some(wrap) = wrap {
            file.json["textures"][texture]["sampler"] = json!(0);
            file.push("samplers", json!({"wrapS": wrap, "wrapT": 10497}));
        }
        let model = file.model();
        assert_eq!(model.textures[0].sample(Vec2::new(1.25, 0.5), 0.0).x, past_the_border, "{wrap:?}");
    }
}

#[test]
fn an_image_that_no_slot_uses_is_neither_needed_nor_decoded() {
    let (mut file, _) = textured(json!({}));
    file.push("images", json!({"uri": "absent.png"}));
    let model = file.model();
    assert_eq!(model.textures.len(), 1);
    assert!(model.document.images.iter().all(Option::is_none));
    assert!(model.notes[0].contains("'absent.png'"), "{:?}", model.notes);
}

#[test]
fn images_given_by_uri_are_kept_with_their_sniffed_type() {
    use base64::Engine as _;
    let (mut file, _) = textured(json!({}));
    let encoded = base64::engine::general_purpose::STANDARD.encode(png([1, 2, 3, 4]));
    file.json["images"][0] = json!({"uri": format!("data:image/jpeg;base64,{encoded}")});
    let model = file.model();
    assert_eq!(model.document.images[0].as_ref().map(|(_, mime)| *mime), Some("image/png"));
    assert_eq!(model.textures[0].size(), [1, 1]);
}
