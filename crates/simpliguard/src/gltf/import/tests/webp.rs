use glam::Vec2;
use serde_json::json;

use super::builder::{Builder, F32, import_bytes, png};
use crate::gltf::{ExportParams, ImportLimits, export};

const NAME: &str = "EXT_texture_webp";

/// An image of one colour, 8 x 8.
fn encoded(format: image::ImageFormat, colour: [u8; 4]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let texels = image::DynamicImage::from(image::RgbaImage::from_pixel(8, 8, image::Rgba(colour)));
    let written = match format {
        image::ImageFormat::Jpeg => texels.to_rgb8().write_to(&mut bytes, format),
        _ => texels.write_to(&mut bytes, format),
    };
    written.expect("an image");
    bytes.into_inner()
}

/// A triangle whose base colour is an image by the extension alone.
fn textured(bytes: &[u8]) -> Builder {
    let mut file = Builder::triangle();
    file.attribute("TEXCOORD_0", F32, "VEC2", &[[0.0f32, 0.0]; 3]);
    let view = file.view(bytes);
    let image = file.push("images", json!({"bufferView": view, "mimeType": "image/webp"}));
    let texture = file.push("textures", json!({"extensions": {NAME: {"source": image}}}));
    file.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}));
    file.json["extensionsUsed"] = json!([NAME]);
    file.json["extensionsRequired"] = json!([NAME]);
    file
}

#[test]
fn the_document_holds_a_png_with_the_same_texels() {
    let texel = [200, 100, 50, 128];
    let model = textured(&encoded(image::ImageFormat::WebP, texel)).model();
    let json = &model.document.json;
    assert!(
        model.document.decoded && !json.to_string().contains("webp") && json["textures"][0] == json!({"source": 0})
    );
    assert_eq!(json["images"][0]["mimeType"], "image/png");
    let glb = export(&model, &[], &ExportParams::default()).expect("exports");
    let again = import_bytes(&glb, &ImportLimits::default()).expect("imports");
    assert!(!again.document.decoded);
    let plain = {
        let mut file = Builder::triangle();
        let texture = file.texture(texel);
        file.attribute("TEXCOORD_0", F32, "VEC2", &[[0.0f32, 0.0]; 3]);
        file.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}));
        file.model()
    };
    let sample = |model: &crate::data::Model| model.textures[0].sample(Vec2::splat(0.4), 0.0);
    assert_eq!(sample(&model), sample(&again));
    assert!(sample(&model).abs_diff_eq(sample(&plain), 1e-6));
}

#[test]
fn webp_without_the_extension_is_decoded_too() {
    let mut file = textured(&encoded(image::ImageFormat::WebP, [9; 4]));
    file.json["textures"][0] = json!({"source": 0});
    file.json.as_object_mut().expect("an object").retain(|key, _| !key.starts_with("extensions"));
    let document = file.model().document;
    assert!(document.decoded && document.json["images"][0]["mimeType"] == "image/png");
}

#[test]
fn an_image_of_another_kind_becomes_a_plain_source() {
    for bytes in [png([0; 4]), encoded(image::ImageFormat::Jpeg, [255, 0, 0, 255])] {
        let model = textured(&bytes).model();
        let json = &model.document.json;
        assert_eq!((&json["textures"][0], json.get("extensionsRequired")), (&json!({"source": 0}), None));
        assert!(model.document.buffers[0].windows(bytes.len()).any(|window| window == bytes));
    }
}

#[test]
fn a_fallback_image_stays_the_source() {
    let mut file = textured(&encoded(image::ImageFormat::WebP, [9; 4]));
    let view = file.view(&png([255, 0, 0, 255]));
    let fallback = file.push("images", json!({"bufferView": view}));
    file.json["textures"][0]["source"] = json!(fallback);
    file.json.as_object_mut().expect("an object").remove("extensionsRequired");
    let document = file.model().document;
    assert!(!document.decoded && document.json["textures"][0]["source"] == fallback);
}

#[test]
fn broken_images_matter_only_where_they_are_used() {
    let sound = encoded(image::ImageFormat::WebP, [9; 4]);
    for length in [12, sound.len() / 2, sound.len() - 8] {
        let broken = textured(&sound[..length]);
        let message = broken.message();
        assert!(message.contains("image 0") && message.contains("cannot be decoded"), "{message}");
        let mut unused = textured(&sound[..length]);
        unused.json["materials"] = json!([{}]);
        assert_eq!(unused.model().textures.len(), 0);
    }
}
