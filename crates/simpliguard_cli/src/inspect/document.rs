//! Sizes of what a glTF refers to.

use std::collections::BTreeSet;

use serde_json::Value;
use simpliguard::data::Model;
use simpliguard::gltf::{encoded_image, image_of_texture, texture_memory, textures_of_material};

use crate::images::size_of_image;

/// The extension that draws a node many times.
pub(crate) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// Modes of primitives: single triangles, which is the default, and strips and fans.
pub(crate) const TRIANGLES: u64 = 4;
const STRIPS: [u64; 2] = [5, 6];

/// The JSON of a glTF and the bytes of its images.
pub(crate) struct Document<'a> {
    source: &'a simpliguard::data::Document,
    /// Width and height of each image, if they can be read.
    sizes: Vec<Option<[u32; 2]>>,
}

impl<'a> Document<'a> {
    pub(crate) fn new(model: &'a Model) -> Self {
        Self::of(&model.document)
    }

    /// The lists of a file and the sizes of its images.
    pub(crate) fn of(source: &'a simpliguard::data::Document) -> Self {
        let mut document = Self { source, sizes: Vec::new() };
        let images = 0..document.list("images").len();
        document.sizes = images.map(|image| size_of_image(encoded_image(source, image)?)).collect();
        document
    }

    /// A top-level list; empty if there is none.
    pub(crate) fn list(&self, name: &str) -> &'a [Value] {
        self.source.json.get(name).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
    }

    /// Width and height of an image.
    pub(crate) fn size_of_image(&self, image: usize) -> Option<[u32; 2]> {
        *self.sizes.get(image)?
    }

    /// The image that a texture shows.
    pub(crate) fn image_of_texture(&self, texture: usize) -> Option<usize> {
        image_of_texture(self.source, texture)
    }

    /// Bytes of a texture in memory, with mipmaps; none if its image cannot be read.
    pub(crate) fn texture_memory(&self, texture: usize) -> u64 {
        texture_memory(self.source, texture).unwrap_or(0)
    }

    /// The textures of a material.
    pub(crate) fn textures_of_material(&self, material: usize) -> BTreeSet<usize> {
        textures_of_material(self.source, material)
    }

    /// Bytes in the file of the vertices, indices and images of meshes. What several meshes share counts once.
    fn bytes_of_meshes(&self, meshes: impl IntoIterator<Item = usize>) -> u64 {
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
        views.iter().filter_map(length).map(|length| length as u64).sum()
    }

    /// The same of the meshes of nodes.
    pub(crate) fn bytes_of_nodes(&self, nodes: &[usize]) -> u64 {
        self.bytes_of_meshes(nodes.iter().filter_map(|&node| index(self.list("nodes").get(node)?, "mesh")))
    }

    /// The images that the materials of a mesh show.
    pub(crate) fn images_of_mesh(&self, mesh: usize) -> BTreeSet<usize> {
        let materials = self.primitives(mesh).iter().filter_map(|primitive| index(primitive, "material"));
        let textures = materials.flat_map(|material| self.textures_of_material(material));
        textures.filter_map(|texture| self.image_of_texture(texture)).collect()
    }

    /// The primitives of a mesh.
    fn primitives(&self, mesh: usize) -> &'a [Value] {
        let primitives = self.list("meshes").get(mesh).and_then(|mesh| mesh.get("primitives"));
        primitives.and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
    }
}

/// Triangles of a node's mesh, with all instances.
pub(crate) fn triangles_of_node(json: &Value, node: usize) -> u64 {
    let node = json.get("nodes").and_then(|nodes| nodes.get(node));
    let mesh = node.and_then(|node| index(node, "mesh"));
    let instancing = node.and_then(|node| node.get("extensions")?.get(INSTANCING)?.get("attributes")?.as_object());
    let accessor = instancing.and_then(|attributes| attributes.values().find_map(as_index));
    let instances = accessor.map_or(Some(1), |accessor| count_of(json, accessor)).unwrap_or(0);
    mesh.map_or(0, |mesh| triangles_of_mesh(json, mesh)) * instances
}

/// Triangles of a mesh, by the counts of its accessors.
pub(crate) fn triangles_of_mesh(json: &Value, mesh: usize) -> u64 {
    let mesh = json.get("meshes").and_then(|meshes| meshes.get(mesh));
    let primitives = mesh.and_then(|mesh| mesh.get("primitives")?.as_array()).into_iter().flatten();
    primitives.filter_map(|primitive| triangles_of_primitive(json, primitive)).sum()
}

/// Triangles of a primitive. `None` if it has points or lines.
pub(crate) fn triangles_of_primitive(json: &Value, primitive: &Value) -> Option<u64> {
    let positions = || index(primitive.get("attributes")?, "POSITION");
    let corners = count_of(json, index(primitive, "indices").or_else(positions)?)?;
    match primitive.get("mode").map_or(Some(TRIANGLES), Value::as_u64)? {
        TRIANGLES => Some(corners / 3),
        mode if STRIPS.contains(&mode) => Some(corners.saturating_sub(2)),
        _ => None,
    }
}

/// The number of elements of an accessor.
fn count_of(json: &Value, accessor: usize) -> Option<u64> {
    json.get("accessors")?.get(accessor)?.get("count")?.as_u64()
}

/// A property that refers to an item of a list, or counts.
pub(crate) fn index(object: &Value, name: &str) -> Option<usize> {
    object.get(name).and_then(as_index)
}

fn as_index(value: &Value) -> Option<usize> {
    usize::try_from(value.as_u64()?).ok()
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
        let source = simpliguard::data::Document { json, ..Default::default() };
        let document = Document::of(&source);
        assert_eq!([document.bytes_of_meshes([0, 0]), document.bytes_of_meshes([7])], [4321, 0]);
    }

    #[test]
    fn triangles_are_counted_by_mode_and_instance() {
        let json = json!({
            "nodes": [{"mesh": 0}, {"mesh": 0, "extensions": {INSTANCING: {"attributes": {"SCALE": 1}}}}, {}],
            "meshes": [{"primitives": [
                {"attributes": {"POSITION": 0}},
                {"attributes": {"POSITION": 1}, "indices": 0, "mode": 5},
                {"attributes": {"POSITION": 0}, "mode": 1},
            ]}],
            "accessors": [{"count": 12}, {"count": 5}],
        });
        assert_eq!([0, 1, 2, 9].map(|node| triangles_of_node(&json, node)), [4 + 10, 5 * 14, 0, 0]);
    }
}
