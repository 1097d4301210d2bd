use glam::Vec2;
use serde_json::json;

use super::blobs::{etc1s, etc1s_alpha, uastc, uastc_zstd};
use super::builder::{Builder, F32, png};
use crate::gltf::import::ktx2::Ktx2;
use crate::gltf::{ExportParams, ImportLimits, export};

const NAME: &str = "KHR_texture_basisu";

/// A triangle whose base colour is a KTX2 image by the extension alone.
fn textured(bytes: &[u8]) -> Builder {
    let mut file = Builder::triangle();
    file.attribute("TEXCOORD_0", F32, "VEC2", &[[0.0f32, 0.0]; 3]);
    let view = file.view(bytes);
    let image = file.push("images", json!({"bufferView": view, "mimeType": "image/ktx2"}));
    let texture = file.push("textures", json!({"extensions": {NAME: {"source": image}}}));
    file.material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}));
    file.json["extensionsUsed"] = json!([NAME]);
    file.json["extensionsRequired"] = json!([NAME]);
    file
}

/// Plain texels of a Vulkan format, 2 x 1.
fn plain(format: u32, texels: &[u8]) -> Vec<u8> {
    let mut out = b"\xABKTX 20\xBB\r\n\x1A\n".to_vec();
    let words = [format, 1, 2, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    out.extend([104, texels.len() as u64, texels.len() as u64].iter().flat_map(|number| number.to_le_bytes()));
    out.extend_from_slice(texels);
    out
}

fn decode(bytes: &[u8]) -> Result<image::RgbaImage, String> {
    Ktx2::new(bytes, 32_768)?.decode()
}

fn texel(image: &image::RgbaImage, x: u32, y: u32) -> [u8; 4] {
    image.get_pixel(x, y).0
}

#[test]
fn basis_universal_texels_are_those_of_the_reference_decoder() {
    // Corners, and the sum of all bytes.
    let corners = |bytes: &[u8]| {
        let image = decode(bytes).expect("an image");
        let right = image.width() - 1;
        let sum: u32 = image.iter().map(|&byte| u32::from(byte)).sum();
        ([(0, 0), (right, 0), (0, 5), (right, 5)].map(|(x, y)| texel(&image, x, y)), sum)
    };
    let (texels, sum) = corners(&etc1s());
    assert_eq!(texels, [[213, 15, 156, 255], [0, 15, 156, 255], [255, 163, 106, 255], [57, 173, 33, 255]]);
    assert_eq!(sum, 37_332);
    let (texels, _) = corners(&etc1s_alpha());
    assert_eq!(texels, [[237, 15, 105, 57], [0, 14, 105, 173], [255, 198, 17, 57], [41, 198, 17, 173]]);
    let (texels, sum) = corners(&uastc());
    assert_eq!(texels, [[255, 0, 201, 59], [32, 0, 201, 131], [255, 194, 10, 74], [32, 194, 10, 114]]);
    assert_eq!(sum, 27_080);
    let (texels, sum) = corners(&uastc_zstd());
    assert_eq!(texels, [[255, 0, 201, 59], [32, 0, 201, 212], [255, 194, 199, 74], [32, 194, 199, 195]]);
    assert_eq!(sum, 121_423);
}

#[test]
fn plain_texels_are_copied() {
    let rgba = decode(&plain(43, &[1, 2, 3, 4, 5, 6, 7, 8])).expect("RGBA");
    assert_eq!((texel(&rgba, 0, 0), texel(&rgba, 1, 0)), ([1, 2, 3, 4], [5, 6, 7, 8]));
    let rgb = decode(&plain(23, &[1, 2, 3, 4, 5, 6])).expect("RGB");
    assert_eq!((texel(&rgb, 0, 0), texel(&rgb, 1, 0)), ([1, 2, 3, 255], [4, 5, 6, 255]));
    assert!(decode(&plain(37, &[0; 7])).expect_err("too short").contains("7 of 8 bytes"));
    assert!(decode(&plain(98, &[0; 8])).expect_err("BC1").contains("Vulkan format 98"));
}

#[test]
fn the_document_holds_a_png_that_imports_again() {
    for bytes in [etc1s(), etc1s_alpha(), uastc(), uastc_zstd()] {
        let model = textured(&bytes).model();
        let json = &model.document.json;
        assert!(model.document.decoded && !json.to_string().contains("basisu") && json["textures"][0]["source"] == 0);
        assert_eq!(json["images"][0]["mimeType"], "image/png");
        let glb = export(&model, &[], &ExportParams::default()).expect("exports");
        assert!(!glb.windows(7).any(|bytes| bytes == b"\xABKTX 20"));
        let again = super::builder::import_bytes(&glb, &ImportLimits::default()).expect("imports");
        let at = |model: &crate::data::Model| model.textures[0].sample(Vec2::splat(0.4), 0.0);
        assert_eq!(at(&again), at(&model));
        assert!(!again.document.decoded);
    }
}

#[test]
fn a_fallback_image_is_preferred_and_the_document_stays() {
    let mut file = textured(b"\xABKTX 20\xBB broken");
    let view = file.view(&png([255, 0, 0, 255]));
    let fallback = file.push("images", json!({"bufferView": view}));
    file.json["textures"][0]["source"] = json!(fallback);
    file.json.as_object_mut().expect("an object").remove("extensionsRequired");
    let model = file.model();
    assert_eq!(model.textures[0].size(), [1, 1]);
    assert!(!model.document.decoded && model.document.json.to_string().contains(NAME));
}

#[test]
fn ktx2_without_the_extension_is_read_too() {
    let mut file = textured(&uastc());
    file.json["textures"][0] = json!({"source": 0});
    file.json.as_object_mut().expect("an object").retain(|key, _| !key.starts_with("extensions"));
    let model = file.model();
    assert_eq!((model.textures[0].size(), model.document.decoded), ([8, 8], true));
}

#[test]
fn broken_images_matter_only_where_they_are_used() {
    let broken = textured(&uastc()[..200]);
    let message = broken.message();
    assert!(message.contains("image 0") && message.contains("ktxdecompress"), "{message}");
    let mut unused = textured(&uastc()[..200]);
    unused.json["materials"] = json!([{}]);
    let model = unused.model();
    assert!(model.notes.iter().any(|note| note.contains("image 0")), "{:?}", model.notes);
}

#[test]
fn huge_sizes_are_refused_by_their_header() {
    let with_side = |side: u32| {
        let mut bytes = etc1s();
        bytes[20..24].copy_from_slice(&side.to_le_bytes());
        bytes[24..28].copy_from_slice(&side.to_le_bytes());
        bytes
    };
    assert!(textured(&with_side(16_385)).message().contains("16385 x 16385 texels"));
    assert!(textured(&with_side(u32::MAX)).message().contains("4294967295 x 4294967295"));
}

#[test]
fn broken_bytes_give_an_error_or_an_image() {
    // Sizes may say anything; small ones keep the test quick.
    const SIZE: std::ops::Range<usize> = 20..28;
    for bytes in [etc1s(), etc1s_alpha(), uastc(), uastc_zstd()] {
        for at in (0..bytes.len()).filter(|at| !SIZE.contains(at)) {
            for flip in [0x01, 0x5A, 0x80, 0xFF] {
                let mut changed = bytes.clone();
                changed[at] ^= flip;
                drop(decode(&changed));
            }
        }
        for length in 0..bytes.len() {
            drop(decode(&bytes[..length]));
        }
        assert!(decode(&bytes).is_ok());
    }
}
