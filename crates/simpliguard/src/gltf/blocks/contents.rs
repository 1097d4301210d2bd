//! The images of a file that can lie in blocks, and their content.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use simpliguard_texture::Content;

use crate::gltf::gpu_cost::find_textures;

/// Filters of samplers: that of pixel art, where blocks would show, and the one with smooth mipmaps.
const NEAREST: usize = 9728;
const LINEAR_MIPMAP_LINEAR: usize = 9987;

/// The images that can lie in blocks: those that only materials of primitives show, in the textures of glTF itself. The
/// plugin learns of textures by the primitives, and nobody knows the content of a texture of an extension.
pub(super) fn contents(json: &Value) -> BTreeMap<usize, Content> {
    let (used, mut excluded) = (materials_of_primitives(json), BTreeSet::new());
    let mut uses = Vec::new();
    for (i, material) in list(json, "materials").iter().enumerate() {
        if used.contains(&i) {
            uses.extend(textures(material));
            find_textures(material.get("extensions").unwrap_or(&Value::Null), &mut excluded);
        } else {
            find_textures(material, &mut excluded);
        }
    }
    let mut of_image: BTreeMap<usize, Option<Content>> = BTreeMap::new();
    for (i, texture) in list(json, "textures").iter().enumerate() {
        let Some(image) = number(texture, "source") else { continue };
        let is_known = !excluded.contains(&i) && is_plain(json, texture);
        let of_texture = uses.iter().filter(|(texture, _)| *texture == i && is_known);
        let own = of_texture.map(|(_, content)| Some(*content)).reduce(|a, b| common(a?, b?)).flatten();
        of_image
            .entry(image)
            .and_modify(|known| *known = known.zip(own).and_then(|(a, b)| common(a, b)))
            .or_insert(own);
    }
    of_image.into_iter().filter_map(|(image, content)| Some((image, content?))).collect()
}

fn materials_of_primitives(json: &Value) -> BTreeSet<usize> {
    let primitives = list(json, "meshes").iter().flat_map(|mesh| list(mesh, "primitives"));
    primitives.filter_map(|primitive| number(primitive, "material")).collect()
}

/// The textures of a material, without those of its extensions.
fn textures(material: &Value) -> impl Iterator<Item = (usize, Content)> {
    let colour = match material.get("alphaMode").and_then(Value::as_str) {
        Some("MASK") => {
            Content::CutOut(material.get("alphaCutoff").and_then(Value::as_f64).map_or(0.5, |least| least as f32))
        }
        _ => Content::Colour,
    };
    let all = [
        ("/pbrMetallicRoughness/baseColorTexture", colour),
        ("/emissiveTexture", Content::Colour),
        ("/normalTexture", Content::Normals),
        ("/pbrMetallicRoughness/metallicRoughnessTexture", Content::Data),
        ("/occlusionTexture", Content::Data),
    ];
    all.into_iter().filter_map(|(path, content)| Some((number(material.pointer(path)?, "index")?, content)))
}

/// False for textures with extensions, for pixel art, and for textures that want no smooth mipmaps.
fn is_plain(json: &Value, texture: &Value) -> bool {
    let sampler = number(texture, "sampler").and_then(|sampler| list(json, "samplers").get(sampler));
    let filter = |name| number(sampler?, name);
    texture.get("extensions").is_none()
        && filter("magFilter").is_none_or(|filter| filter != NEAREST)
        && filter("minFilter").is_none_or(|filter| filter == LINEAR_MIPMAP_LINEAR)
}

/// The content of an image that is used for both. `None` if its mipmaps cannot suit both.
fn common(a: Content, b: Content) -> Option<Content> {
    match (a, b) {
        (a, b) if a == b => Some(a),
        (Content::CutOut(least), Content::Colour | Content::CutOut(_)) | (Content::Colour, Content::CutOut(least)) => {
            Some(Content::CutOut(least))
        }
        _ => None,
    }
}

fn list<'a>(object: &'a Value, key: &str) -> &'a [Value] {
    object.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn number(object: &Value, key: &str) -> Option<usize> {
    object.get(key).and_then(Value::as_u64).and_then(|number| usize::try_from(number).ok())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// The content of the images of a file with these materials, of which the primitives use all but the last.
    fn of(materials: &Value) -> Vec<(usize, Content)> {
        let count = materials.as_array().expect("a list").len();
        let primitives: Vec<Value> = (0..count - 1).map(|material| json!({ "material": material })).collect();
        let json = json!({
            "meshes": [{ "primitives": primitives }],
            "materials": materials,
            "textures": [
                { "source": 0 }, { "source": 1 }, { "source": 1 }, { "source": 2, "sampler": 0 },
                { "source": 3, "extensions": { "EXT_texture_webp": { "source": 3 } } }, { "source": 4, "sampler": 1 },
                { "source": 5, "sampler": 2 },
            ],
            "samplers": [{ "magFilter": 9728 }, { "magFilter": 9729, "minFilter": 9987 }, { "minFilter": 9729 }],
        });
        contents(&json).into_iter().collect()
    }

    fn base(texture: usize) -> Value {
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } })
    }

    #[test]
    fn each_texture_of_a_material_has_its_content() {
        let material = json!({
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 1 } },
            "occlusionTexture": { "index": 2 }, "normalTexture": { "index": 5 },
        });
        let expected = [(0, Content::Colour), (1, Content::Data), (4, Content::Normals)];
        assert_eq!(of(&json!([material, {}])), expected);
    }

    #[test]
    fn pixel_art_and_textures_with_extensions_stay() {
        assert_eq!(of(&json!([base(3), base(4), base(5), base(6), {}])), [(4, Content::Colour)]);
    }

    #[test]
    fn an_image_that_somebody_else_may_show_stays() {
        let clearcoat = json!({ "KHR_materials_clearcoat": { "clearcoatTexture": { "index": 0 } } });
        assert_eq!(of(&json!([base(0), { "extensions": clearcoat }, {}])), []);
        assert_eq!(of(&json!([base(0), base(0)])), [], "a material without primitives");
        assert_eq!(of(&json!([base(1), {}])), [], "another texture shows the same image");
    }

    #[test]
    fn an_image_with_two_contents_stays_unless_one_suits_both() {
        let masked = json!({
            "alphaMode": "MASK", "alphaCutoff": 0.25,
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } },
        });
        let cut_out = [(0, Content::CutOut(0.25))];
        assert_eq!(of(&json!([base(0), masked, {}])), cut_out);
        assert_eq!(of(&json!([masked, base(0), {}])), cut_out);
        assert_eq!(of(&json!([base(0), { "normalTexture": { "index": 0 } }, {}])), []);
        assert_eq!(of(&json!([base(1), { "occlusionTexture": { "index": 2 } }, {}])), []);
    }
}
