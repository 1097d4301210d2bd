//! Sizes of what a glTF refers to.

use std::collections::BTreeSet;

use serde_json::Value;
use simpliguard::data::Model;

use crate::images::size_of_image;

/// The JSON of a glTF and the bytes of its images.
pub(crate) struct Document<'a> {
    json: &'a Value,
    /// Width and height of each image, if they can be read.
    sizes: Vec<Option<[u32; 2]>>,
}

impl<'a> Document<'a> {
    pub(crate) fn new(model: &'a Model) -> Self {
        Self::of(&model.document)
    }

    /// The lists of a file and the sizes of its images.
    pub(crate) fn of(source: &'a simpliguard::data::Document) -> Self {
        let mut document = Self { json: &source.json, sizes: Vec::new() };
        let sizes = document.list("images").iter().enumerate().map(|(i, image)| {
            let outside = source.images.get(i).and_then(Option::as_ref).map(|(bytes, _)| bytes.as_ref());
            let inside = || {
                let view = document.list("bufferViews").get(index(image, "bufferView")?)?;
                let start = index(view, "byteOffset").unwrap_or(0);
                source.buffers.get(index(view, "buffer")?)?.get(start..start.checked_add(index(view, "byteLength")?)?)
            };
            size_of_image(outside.or_else(inside)?)
        });
        document.sizes = sizes.collect();
        document
    }

    /// A top-level list; empty if there is none.
    pub(crate) fn list(&self, name: &str) -> &'a [Value] {
        self.json.get(name).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
    }

    /// Width and height of an image.
    pub(crate) fn size_of_image(&self, image: usize) -> Option<[u32; 2]> {
        *self.sizes.get(image)?
    }

    /// The image that a texture shows.
    pub(crate) fn image_of_texture(&self, texture: usize) -> Option<usize> {
        let texture = self.list("textures").get(texture)?;
        let webp = || index(texture.pointer("/extensions/EXT_texture_webp")?, "source");
        index(texture, "source").or_else(webp)
    }

    /// The textures of a material.
    pub(crate) fn textures_of_material(&self, material: usize) -> BTreeSet<usize> {
        let mut found = BTreeSet::new();
        if let Some(material) = self.list("materials").get(material) {
            find_textures(material, &mut found);
        }
        found
    }

    /// Bytes in the file of the vertices, indices and images of meshes, and bytes in memory of their textures. What several
    /// meshes share counts once.
    pub(crate) fn size_of_meshes(&self, meshes: impl IntoIterator<Item = usize>) -> (u64, u64) {
        let (mut accessors, mut images) = (BTreeSet::new(), BTreeSet::new());
        for primitive in meshes.into_iter().flat_map(|mesh| self.primitives(mesh)) {
            let targets = primitive.get("targets").and_then(Value::as_array).into_iter().flatten();
            let sets = primitive.get("attributes").into_iter().chain(targets).filter_map(Value::as_object);
            accessors.extend(sets.flat_map(|set| set.values()).filter_map(as_index));
            accessors.extend(index(primitive, "indices"));
            let textures = index(primitive, "material").map(|m| self.textures_of_material(m)).unwrap_or_default();
            images.extend(textures.into_iter().filter_map(|texture| self.image_of_texture(texture)));
        }
        let view = |list: &str, i: usize| index(self.list(list).get(i)?, "bufferView");
        let views = accessors.iter().filter_map(|&i| view("accessors", i));
        let views: BTreeSet<usize> = views.chain(images.iter().filter_map(|&i| view("images", i))).collect();
        let length = |view: &usize| index(self.list("bufferViews").get(*view)?, "byteLength");
        let bytes = views.iter().filter_map(length).map(|length| length as u64).sum();
        let memory = images.iter().filter_map(|&image| self.size_of_image(image)).map(texture_memory).sum();
        (bytes, memory)
    }

    /// The images that the materials of a mesh show.
    pub(crate) fn images_of_mesh(&self, mesh: usize) -> BTreeSet<usize> {
        let materials = self.primitives(mesh).iter().filter_map(|primitive| index(primitive, "material"));
        let textures = materials.flat_map(|material| self.textures_of_material(material));
        textures.filter_map(|texture| self.image_of_texture(texture)).collect()
    }

    /// The primitives of a mesh; each is a draw call.
    pub(crate) fn primitives(&self, mesh: usize) -> &'a [Value] {
        let primitives = self.list("meshes").get(mesh).and_then(|mesh| mesh.get("primitives"));
        primitives.and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
    }
}

/// Bytes in memory of a texture of this size: four a texel, and a third of that for mipmaps.
pub(crate) fn texture_memory([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height) * 4 * 4 / 3
}

/// A property that refers to an item of a list, or counts.
pub(crate) fn index(object: &Value, name: &str) -> Option<usize> {
    object.get(name).and_then(as_index)
}

fn as_index(value: &Value) -> Option<usize> {
    usize::try_from(value.as_u64()?).ok()
}

/// Collects the `index` of every property whose name ends in `Texture`, also within extensions.
fn find_textures(value: &Value, found: &mut BTreeSet<usize>) {
    for (name, value) in value.as_object().into_iter().flatten() {
        if name.ends_with("Texture") {
            found.extend(index(value, "index"));
        }
        find_textures(value, found);
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_mesh_takes_up_what_it_refers_to_once() {
        let json = json!({
            "meshes": [{"primitives": [
                {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0},
                {"attributes": {"POSITION": 0}, "targets": [{"POSITION": 3}], "material": 9},
            ]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1},
                           "extensions": {"KHR_x": {"someTexture": {"index": 0}}}}],
            "textures": [{"source": 0}, {"extensions": {"EXT_texture_webp": {"source": 1}}}],
            "images": [{"bufferView": 3}, {"uri": "beside.png"}],
            "accessors": [{"bufferView": 0}, {"bufferView": 0}, {"bufferView": 1}, {"bufferView": 2}],
            "bufferViews": [{"byteLength": 1}, {"byteLength": 20}, {"byteLength": 300}, {"byteLength": 4000},
                            {"byteLength": 50000}],
        });
        let document = Document { json: &json, sizes: vec![Some([64, 32]), Some([3, 1])] };
        assert_eq!(document.size_of_meshes([0, 0]), (4321, 64 * 32 * 16 / 3 + 16));
        assert_eq!(document.size_of_meshes([7]), (0, 0));
    }
}
