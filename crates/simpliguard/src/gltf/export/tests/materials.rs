//! Materials and textures of levels.

use glam::{Vec2, Vec4};

use super::*;
use crate::data::Material;

#[test]
fn materials_carry_every_mode() {
    let mut level = level(1000, false);
    level.layers[0].material = LayerMaterial::Baked(LevelMaterial {
        alpha_mode: AlphaMode::Mask { cutoff: 0.3 },
        double_sided: true,
        unlit: true,
        metallic: 0.0,
        roughness: 0.0,
        emissive: Vec3::new(4.0, 2.0, 0.0),
        base_color: Vec4::ONE,
        transmission: None,
    });
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

fn own_material(level: &Level) -> LevelMaterial {
    level.layers[0].material.baked().expect("its own").clone()
}

/// An image in each place that has one.
fn all_textures(format: TextureFormat) -> LevelTextures {
    let map = || Some(RgbImage::from_pixel(4, 4, Rgb([128, 128, 255])));
    LevelTextures {
        base_color: Some(base_color(77)),
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
        let material = LevelMaterial { alpha_mode, emissive: Vec3::ONE, ..own_material(&level) };
        level.layers[0].material = LayerMaterial::Baked(material);
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
fn a_clear_layer_is_a_primitive_of_its_own() {
    let mut level = level(1000, false);
    level.mesh.triangles.push([2, 1, 0]);
    let transmission = Transmission {
        factor: 0.5,
        ior: 1.25,
        thickness: 2.0,
        attenuation_distance: 4.0,
        attenuation_color: Vec3::ONE,
    };
    let material =
        LevelMaterial { alpha_mode: AlphaMode::Blend, transmission: Some(transmission), ..own_material(&level) };
    level.layers.push(LevelLayer { triangles: 1, material: LayerMaterial::Baked(material) });
    level.textures.base_color = Some(base_color(77));
    let read = Read::new("clear", &export_level(&triangle(), &level).expect("exports"));
    assert_eq!(read.json["meshes"][0]["primitives"].as_array().map(Vec::len), Some(2));
    assert_eq!(
        (&read.json["materials"][0]["alphaMode"], &read.json["materials"][0]["extensions"]),
        (&Value::Null, &Value::Null)
    );
    let clear = &read.json["materials"][1];
    assert_eq!((&clear["name"], &clear["alphaMode"]), (&json!("LOD clear"), &json!("BLEND")));
    assert_eq!(clear["extensions"]["KHR_materials_transmission"]["transmissionFactor"], json!(0.5));
    assert_eq!(clear["extensions"]["KHR_materials_ior"]["ior"], json!(1.25));
    let volume = &clear["extensions"]["KHR_materials_volume"];
    assert_eq!((&volume["thicknessFactor"], &volume["attenuationDistance"]), (&json!(2.0), &json!(4.0)));
}

#[test]
fn a_level_may_keep_the_materials_of_its_source() {
    let material = |index: Option<usize>| Material { index, ..Material::default() };
    let model = Model { materials: vec![material(Some(0)), material(None)], ..triangle() };
    let mut level = level(1000, false);
    level.mesh.triangles.push([2, 1, 0]);
    level.mesh.colors = vec![Vec4::new(1.0, 0.5, 0.0, 1.0); 3];
    level.mesh.second_uvs = vec![Vec2::ZERO; 3];
    level.layers = [0, 1].map(|m| LevelLayer { triangles: 1, material: LayerMaterial::Source(m) }).to_vec();
    level.textures.base_color = None;
    let kept = |read: &Read, mesh: usize| {
        let primitives = read.json["meshes"][mesh]["primitives"].as_array().expect("primitives");
        assert_eq!((&primitives[0]["material"], primitives[1].get("material")), (&json!(0), None));
        assert_eq!(primitives[0]["attributes"].get("TEXCOORD_1"), None, "it says nothing");
        assert!(primitives[0]["attributes"].get("COLOR_0").is_some());
        for kind in ["materials", "textures", "images"] {
            assert_eq!(read.json[kind].as_array().map(Vec::len), Some(1), "{kind}");
        }
    };
    let whole = export(&model, &[level.clone()], &ExportParams { keep_source: true }).expect("exports");
    kept(&Read::new("kept", &whole), 1);
    kept(&Read::new("kept_alone", &export_level(&model, &level).expect("exports")), 0);
    level.layers[1].material = LayerMaterial::Source(2);
    let message = export_level(&model, &level).expect_err("broken").to_string();
    assert!(message.contains("keeps material 2 of 2"), "{message}");
}

#[test]
fn a_level_may_have_materials_of_both_kinds() {
    let model = Model { materials: vec![Material { index: Some(0), ..Material::default() }], ..triangle() };
    let mut level = level(1000, false);
    let own = level.layers[0].clone();
    level.mesh.triangles.push([2, 1, 0]);
    level.mesh.colors = vec![Vec4::new(1.0, 0.5, 0.0, 1.0); 3];
    level.mesh.second_uvs = vec![Vec2::ONE; 3];
    level.layers = vec![LevelLayer { triangles: 1, material: LayerMaterial::Source(0) }, own];
    let glb = export(&model, &[level], &ExportParams { keep_source: true }).expect("exports");
    let read = Read::new("both", &glb);
    let primitives = read.json["meshes"][1]["primitives"].as_array().expect("primitives");
    assert_eq!((&primitives[0]["material"], &primitives[1]["material"]), (&json!(0), &json!(1)));
    for attribute in ["TEXCOORD_1", "COLOR_0"] {
        let has = |primitive: &Value| primitive["attributes"].get(attribute).is_some();
        assert_eq!((has(&primitives[0]), has(&primitives[1])), (true, false), "{attribute}");
    }
}
