//! The contents of a model.

use serde::Serialize;
use serde_json::Value;
use simpliguard::data::Model;

use super::document::{Document, index};

/// The contents of a model, by the lists of its file.
#[derive(Serialize)]
pub(super) struct Contents {
    /// Triangles and vertices of the default scene, with all instances.
    pub(super) triangles: usize,
    pub(super) vertices: usize,
    pub(super) scenes: usize,
    pub(super) nodes: usize,
    pub(super) meshes: Vec<Mesh>,
    pub(super) materials: Vec<MaterialInfo>,
    pub(super) textures: Vec<TextureInfo>,
    pub(super) skins: Vec<Skin>,
    pub(super) clips: Vec<Clip>,
}

#[derive(Serialize)]
pub(super) struct Mesh {
    pub(super) name: String,
    pub(super) primitives: usize,
    pub(super) morph_targets: usize,
}

#[derive(Serialize)]
pub(super) struct MaterialInfo {
    pub(super) name: String,
    pub(super) alpha_mode: String,
    pub(super) double_sided: bool,
    /// Indices of its textures.
    pub(super) textures: Vec<usize>,
}

#[derive(Serialize)]
pub(super) struct TextureInfo {
    pub(super) name: String,
    /// Null if the image cannot be read.
    pub(super) size: Option<[u32; 2]>,
    /// Bytes in memory with mipmaps.
    pub(super) memory: u64,
}

#[derive(Serialize)]
pub(super) struct Skin {
    pub(super) name: String,
    pub(super) joints: usize,
}

#[derive(Serialize)]
pub(super) struct Clip {
    pub(super) name: String,
    /// Null if the file does not say it.
    pub(super) seconds: Option<f64>,
    pub(super) channels: usize,
}

impl Contents {
    pub(super) fn of(model: &Model, document: &Document<'_>) -> Self {
        let texture = |(i, value): (usize, &Value)| {
            let image = document.image_of_texture(i);
            let size = image.and_then(|image| document.size_of_image(image));
            let own = image.and_then(|image| document.list("images").get(image)).map(name).unwrap_or_default();
            let name = if own.is_empty() { name(value) } else { own };
            TextureInfo { name, size, memory: document.texture_memory(i) }
        };
        Self {
            triangles: model.surface.triangles.len(),
            vertices: model.surface.positions.len(),
            scenes: document.list("scenes").len(),
            nodes: document.list("nodes").len(),
            meshes: document.list("meshes").iter().map(mesh).collect(),
            materials: document.list("materials").iter().enumerate().map(|m| material(document, m)).collect(),
            textures: document.list("textures").iter().enumerate().map(texture).collect(),
            skins: document.list("skins").iter().map(|s| Skin { name: name(s), joints: count(s, "joints") }).collect(),
            clips: document.list("animations").iter().map(|c| clip(document, c)).collect(),
        }
    }
}

fn name(value: &Value) -> String {
    value.get("name").and_then(Value::as_str).unwrap_or_default().to_owned()
}

fn count(value: &Value, list: &str) -> usize {
    value.get(list).and_then(Value::as_array).map_or(0, Vec::len)
}

fn mesh(value: &Value) -> Mesh {
    let first = value.pointer("/primitives/0");
    let morph_targets = first.map_or(0, |primitive| count(primitive, "targets"));
    Mesh { name: name(value), primitives: count(value, "primitives"), morph_targets }
}

fn material(document: &Document<'_>, (i, value): (usize, &Value)) -> MaterialInfo {
    MaterialInfo {
        name: name(value),
        alpha_mode: value.get("alphaMode").and_then(Value::as_str).unwrap_or("OPAQUE").to_owned(),
        double_sided: value.get("doubleSided").and_then(Value::as_bool).unwrap_or_default(),
        textures: document.textures_of_material(i).into_iter().collect(),
    }
}

/// A clip. It lasts until the last key of any channel; glTF asks for the bounds of these accessors.
fn clip(document: &Document<'_>, value: &Value) -> Clip {
    let samplers = value.get("samplers").and_then(Value::as_array).into_iter().flatten();
    let inputs = samplers.filter_map(|sampler| document.list("accessors").get(index(sampler, "input")?));
    let last = inputs.filter_map(|input| input.pointer("/max/0")?.as_f64()).reduce(f64::max);
    Clip { name: name(value), seconds: last, channels: count(value, "channels") }
}
