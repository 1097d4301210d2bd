//! Memory and draw calls that meshes of a file cost a game.
//!
//! The figures are those of Bevy 0.19: each texture of a file is an image of its own with all its mipmaps, each primitive has
//! its own vertex buffer, and missing normals and tangents are made when the file is loaded.

use std::collections::BTreeSet;
use std::io::Cursor;

use image::{ColorType, ImageDecoder, ImageReader};
use serde::Serialize;
use serde_json::Value;

use crate::data::Document;

/// Bytes of a vertex attribute on the GPU: position, normal and all others by their names.
const POSITION: u64 = 12;
const NORMAL: u64 = 12;
const TANGENT: u64 = 16;
const ATTRIBUTES: [(&str, u64); 5] =
    [("TEXCOORD_0", 8), ("TEXCOORD_1", 8), ("COLOR_0", 16), ("JOINTS_0", 8), ("WEIGHTS_0", 16)];
/// Bytes of a vertex of a morph target: position, normal and tangent, padded.
const MORPHED_VERTEX: u64 = 48;
/// Component type of 32-bit indices.
const U32: u64 = 5125;

/// Memory on the GPU and draw calls of meshes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GpuCost {
    /// Primitives that are drawn, with all instances.
    pub draw_calls: u64,
    /// Bytes of vertices, indices and morph targets.
    pub mesh_memory: u64,
    /// Bytes of textures with their mipmaps.
    pub texture_memory: u64,
}

/// The cost of the meshes of some nodes. Meshes and textures that several nodes share count once, draw calls for each node.
/// What cannot be read counts nothing.
pub fn gpu_cost(document: &Document, nodes: impl IntoIterator<Item = usize>) -> GpuCost {
    gpu_cost_besides(document, nodes, [])
}

/// As [`gpu_cost`], without the memory of meshes and textures that the nodes in `others` show too: these are there already.
pub fn gpu_cost_besides(
    document: &Document,
    nodes: impl IntoIterator<Item = usize>,
    others: impl IntoIterator<Item = usize>,
) -> GpuCost {
    let (own, others) = (Drawn::by(document, nodes), Drawn::by(document, others));
    let meshes = own.meshes.difference(&others.meshes).flat_map(|&mesh| primitives(document, mesh));
    let textures = own.textures.difference(&others.textures);
    GpuCost {
        draw_calls: own.draw_calls,
        mesh_memory: meshes.filter_map(|primitive| primitive_memory(document, primitive)).sum(),
        texture_memory: textures.filter_map(|&texture| texture_memory(document, texture)).sum(),
    }
}

/// What nodes draw.
#[derive(Default)]
struct Drawn {
    draw_calls: u64,
    meshes: BTreeSet<usize>,
    textures: BTreeSet<usize>,
}

impl Drawn {
    fn by(document: &Document, nodes: impl IntoIterator<Item = usize>) -> Self {
        let mut drawn = Self::default();
        for mesh in nodes.into_iter().filter_map(|node| index(item(document, "nodes", node)?, "mesh")) {
            drawn.draw_calls += primitives(document, mesh).len() as u64;
            if drawn.meshes.insert(mesh) {
                let materials = primitives(document, mesh).iter().filter_map(|primitive| index(primitive, "material"));
                drawn.textures.extend(materials.flat_map(|material| textures_of_material(document, material)));
            }
        }
        drawn
    }
}

fn primitives(document: &Document, mesh: usize) -> &[Value] {
    let mesh = item(document, "meshes", mesh).and_then(|mesh| mesh.get("primitives")?.as_array());
    mesh.map_or(&[], Vec::as_slice)
}

/// Bytes of a texture on the GPU, with its mipmaps. `None` if its image cannot be read.
pub fn texture_memory(document: &Document, texture: usize) -> Option<u64> {
    let image = image_of_texture(document, texture)?;
    if let Some(bytes) = document.block_bytes.get(&image) {
        return Some(*bytes);
    }
    let bytes = encoded_image(document, image)?;
    let decoder = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?.into_decoder().ok()?;
    Some(texels_with_mipmaps(decoder.dimensions().into()) * bytes_per_texel(decoder.color_type()))
}

/// The bytes of an image of the file. `None` if there are none.
pub fn encoded_image(document: &Document, image: usize) -> Option<&[u8]> {
    if let Some((bytes, _)) = document.images.get(image).and_then(Option::as_ref) {
        return Some(bytes);
    }
    let view = item(document, "bufferViews", index(item(document, "images", image)?, "bufferView")?)?;
    let start = index(view, "byteOffset").unwrap_or(0);
    document.buffers.get(index(view, "buffer")?)?.get(start..start.checked_add(index(view, "byteLength")?)?)
}

/// The image that a texture shows.
pub fn image_of_texture(document: &Document, texture: usize) -> Option<usize> {
    let texture = item(document, "textures", texture)?;
    let webp = || index(texture.pointer("/extensions/EXT_texture_webp")?, "source");
    index(texture, "source").or_else(webp)
}

/// The textures of a material, those of its extensions too.
pub fn textures_of_material(document: &Document, material: usize) -> BTreeSet<usize> {
    let mut found = BTreeSet::new();
    item(document, "materials", material).inspect(|material| find_textures(material, &mut found));
    found
}

/// Collects the `index` of every property whose name ends in `Texture`, also within extensions.
pub(super) fn find_textures(value: &Value, found: &mut BTreeSet<usize>) {
    for (name, value) in value.as_object().into_iter().flatten() {
        if name.ends_with("Texture") {
            found.extend(index(value, "index"));
        }
        find_textures(value, found);
    }
}

/// Texels of an image and all its mipmaps.
fn texels_with_mipmaps([mut width, mut height]: [u32; 2]) -> u64 {
    let mut texels = u64::from(width) * u64::from(height);
    while width > 1 || height > 1 {
        (width, height) = ((width / 2).max(1), (height / 2).max(1));
        texels += u64::from(width) * u64::from(height);
    }
    texels
}

/// GPUs have no texels of three channels, and Bevy expands images of 8 bits to four.
fn bytes_per_texel(color: ColorType) -> u64 {
    match color {
        ColorType::L16 => 2,
        ColorType::Rgb16 | ColorType::Rgba16 => 8,
        ColorType::Rgb32F | ColorType::Rgba32F => 16,
        _ => 4,
    }
}

/// Bytes of a primitive's vertices, indices and morph targets.
pub(super) fn primitive_memory(document: &Document, primitive: &Value) -> Option<u64> {
    let attributes = primitive.get("attributes")?.as_object()?;
    let accessor = |value: &Value| item(document, "accessors", as_index(value)?);
    let count = |accessor: &Value| accessor.get("count").and_then(Value::as_u64);
    let indices = primitive.get("indices").and_then(accessor);
    let has_normals = attributes.contains_key("NORMAL");
    let vertices = match indices {
        // Flat normals: each corner of a triangle is a vertex of its own, without indices.
        Some(indices) if !has_normals => count(indices)?,
        _ => count(accessor(attributes.get("POSITION")?)?)?,
    };
    let material = index(primitive, "material").and_then(|material| item(document, "materials", material));
    let has_tangents = attributes.contains_key("TANGENT") || material.is_some_and(|m| m.get("normalTexture").is_some());
    let others =
        ATTRIBUTES.iter().filter(|(name, _)| attributes.contains_key(*name)).map(|(_, bytes)| bytes).sum::<u64>();
    let vertex = POSITION + NORMAL + if has_tangents { TANGENT } else { 0 } + others;
    let index_bytes = match indices.filter(|_| has_normals) {
        Some(indices) if indices.get("componentType").and_then(Value::as_u64) == Some(U32) => 4 * count(indices)?,
        Some(indices) => 2 * count(indices)?,
        None => 0,
    };
    let targets = primitive.get("targets").and_then(Value::as_array).map_or(0, Vec::len) as u64;
    Some(vertices * (vertex + targets * MORPHED_VERTEX) + index_bytes)
}

fn item<'a>(document: &'a Document, list: &str, i: usize) -> Option<&'a Value> {
    document.json.get(list)?.get(i)
}

fn index(object: &Value, name: &str) -> Option<usize> {
    object.get(name).and_then(as_index)
}

fn as_index(value: &Value) -> Option<usize> {
    usize::try_from(value.as_u64()?).ok()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use image::{DynamicImage, ImageFormat};
    use serde_json::json;

    use super::*;

    fn png(image: &DynamicImage) -> Option<(bytes::Bytes, &'static str)> {
        let mut out = Cursor::new(Vec::new());
        image.write_to(&mut out, ImageFormat::Png).expect("writes");
        Some((out.into_inner().into(), "image/png"))
    }

    fn document() -> Document {
        let json = json!({
            "nodes": [{"mesh": 0}, {"mesh": 0}, {"mesh": 1}, {"children": [0]}, {"mesh": 7}],
            "meshes": [
                {"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 0, "TEXCOORD_0": 0}, "indices": 1, "material": 0}]},
                {"primitives": [
                    {"attributes": {"POSITION": 0}, "indices": 1, "material": 1},
                    {"attributes": {"POSITION": 0, "NORMAL": 0}, "indices": 2, "targets": [{}, {}]},
                ]},
            ],
            "materials": [
                {"normalTexture": {"index": 0}, "extensions": {"KHR_x": {"someTexture": {"index": 1}}}},
                {"pbrMetallicRoughness": {"baseColorTexture": {"index": 2}}, "emissiveTexture": {"index": 2}},
            ],
            "textures": [{"source": 0}, {"source": 0}, {"extensions": {"EXT_texture_webp": {"source": 1}}}, {"source": 2}],
            "images": [{}, {}, {}],
            "accessors": [{"count": 100}, {"count": 300, "componentType": 5123}, {"count": 300, "componentType": 5125}],
        });
        let images = vec![png(&DynamicImage::new_rgb8(4, 2)), png(&DynamicImage::new_rgb16(1, 1)), None];
        Document { json, images, ..Document::default() }
    }

    #[test]
    fn meshes_count_once_and_draw_calls_for_each_node() {
        let document = Arc::new(document());
        let vertex = 12 + 12 + 16 + 8;
        let rgb8 = (8 + 2 + 1) * 4;
        let once = GpuCost { draw_calls: 1, mesh_memory: 100 * vertex + 600, texture_memory: 2 * rgb8 };
        assert_eq!(gpu_cost(&document, [0]), once);
        assert_eq!(gpu_cost(&document, [0, 1, 3, 4, 99]), GpuCost { draw_calls: 2, ..once });
        let flat = 300 * 24;
        let morphed = 100 * (24 + 2 * 48) + 1200;
        assert_eq!(gpu_cost(&document, [2]), GpuCost { draw_calls: 2, mesh_memory: flat + morphed, texture_memory: 8 });
    }

    #[test]
    fn what_others_show_costs_no_memory() {
        let own = gpu_cost(&document(), [2]);
        assert_eq!(gpu_cost_besides(&document(), [2], [0]), own);
        let calls_alone = GpuCost { draw_calls: 2, ..GpuCost::default() };
        assert_eq!(gpu_cost_besides(&document(), [0, 1], [1]), calls_alone);
        assert_eq!(gpu_cost_besides(&document(), [0, 2], [0, 3]), GpuCost { draw_calls: 3, ..own });
    }

    #[test]
    fn an_image_that_cannot_be_read_counts_nothing() {
        assert_eq!([0, 2, 3, 4].map(|texture| texture_memory(&document(), texture)), [Some(44), Some(8), None, None]);
    }

    #[test]
    fn an_image_that_was_in_blocks_counts_as_these() {
        let mut document = document();
        document.block_bytes.insert(0, 48);
        assert_eq!([0, 1, 2].map(|texture| texture_memory(&document, texture)), [Some(48), Some(48), Some(8)]);
    }

    #[test]
    fn mipmaps_of_a_square_take_a_third() {
        assert_eq!([[1, 1], [4, 4], [1024, 1024]].map(texels_with_mipmaps), [1, 21, 1_398_101]);
    }
}
