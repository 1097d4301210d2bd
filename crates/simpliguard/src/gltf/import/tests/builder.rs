//! Builds small glTF files for tests.

use std::io::Cursor;

use bytemuck::NoUninit;
use image::{ImageFormat, RgbaImage};
use serde_json::{Value, json};

use crate::data::Model;
use crate::gltf::{ImportLimits, import};
use crate::{Error, NoResources, Source};

pub(super) const U8: u32 = 5121;
pub(super) const I16: u32 = 5122;
pub(super) const U16: u32 = 5123;
pub(super) const U32: u32 = 5125;
pub(super) const F32: u32 = 5126;

/// A glTF in the making: JSON that tests edit at will, and one binary buffer.
pub(super) struct Builder {
    pub(super) json: Value,
    bin: Vec<u8>,
}

impl Builder {
    /// A document with empty lists and scene 0.
    pub(super) fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "buffers": [],
        });
        Self { json, bin: Vec::new() }
    }

    /// One unindexed triangle (0,0,0) (1,0,0) (0,1,0) as mesh 0 on node 0.
    pub(super) fn triangle() -> Self {
        let mut out = Self::new();
        let positions = out.accessor(F32, "VEC3", &[[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        out.push("meshes", json!({"primitives": [{"attributes": {"POSITION": positions}}]}));
        out.root(json!({"mesh": 0}));
        out
    }

    /// Adds `item` to a top-level list and returns its index.
    pub(super) fn push(&mut self, list: &str, item: Value) -> usize {
        let root = self.json.as_object_mut().expect("an object");
        let list = root.entry(list).or_insert_with(|| json!([])).as_array_mut().expect("a list");
        list.push(item);
        list.len() - 1
    }

    /// Adds a root node to scene 0.
    pub(super) fn root(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().expect("a list").push(json!(index));
        index
    }

    pub(super) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub(super) fn accessor<T: NoUninit>(&mut self, component: u32, shape: &str, elements: &[T]) -> usize {
        let view = self.view(bytemuck::cast_slice(elements));
        let accessor = json!({"bufferView": view, "componentType": component, "count": elements.len(), "type": shape});
        self.push("accessors", accessor)
    }

    /// Adds an attribute to primitive 0 of mesh 0.
    pub(super) fn attribute<T: NoUninit>(&mut self, name: &str, component: u32, shape: &str, elements: &[T]) -> usize {
        let accessor = self.accessor(component, shape, elements);
        self.primitive()["attributes"][name] = json!(accessor);
        accessor
    }

    pub(super) fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// Gives primitive 0 the material.
    pub(super) fn material(&mut self, material: Value) {
        let index = self.push("materials", material);
        self.primitive()["material"] = json!(index);
    }

    /// Adds a texture that shows one PNG texel, and returns its index.
    pub(super) fn texture(&mut self, texel: [u8; 4]) -> usize {
        let view = self.view(&png(texel));
        let image = self.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
        self.push("textures", json!({"source": image}))
    }

    /// Binary glTF.
    pub(super) fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if !self.bin.is_empty() && json["buffers"].as_array().is_none_or(Vec::is_empty) {
            json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        }
        let mut text = serde_json::to_vec(&json).expect("JSON");
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut out = b"glTF".to_vec();
        let total = 12 + 8 + text.len() + 8 + bin.len();
        out.extend([2u32, total as u32, text.len() as u32, 0x4E4F_534A].iter().flat_map(|word| word.to_le_bytes()));
        out.extend(text);
        out.extend([bin.len() as u32, 0x004E_4942].iter().flat_map(|word| word.to_le_bytes()));
        out.extend(bin);
        out
    }

    pub(super) fn import(&self) -> Result<Model, Error> {
        self.import_within(&ImportLimits::default())
    }

    pub(super) fn import_within(&self, limits: &ImportLimits) -> Result<Model, Error> {
        import_bytes(&self.glb(), limits)
    }

    /// The model, checked.
    pub(super) fn model(&self) -> Model {
        let model = self.import().unwrap_or_else(|error| panic!("{error}"));
        super::assert_sound(&model);
        model
    }

    /// The message of the import's error.
    pub(super) fn message(&self) -> String {
        self.import().expect_err("an error").to_string()
    }
}

pub(super) fn import_bytes(bytes: &[u8], limits: &ImportLimits) -> Result<Model, Error> {
    import(&Source { name: "test.glb", bytes, resources: &NoResources }, limits)
}

/// A PNG of one texel.
pub(super) fn png(texel: [u8; 4]) -> Vec<u8> {
    let image = RgbaImage::from_pixel(1, 1, image::Rgba(texel));
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, ImageFormat::Png).expect("a PNG");
    out.into_inner()
}

/// The bytes of a PNG whose header says `side` x `side` texels.
pub(super) fn png_with_side(side: u32) -> Vec<u8> {
    let mut out = png([0; 4]);
    out[16..20].copy_from_slice(&side.to_be_bytes());
    out[20..24].copy_from_slice(&side.to_be_bytes());
    let crc = crc32(&out[12..29]);
    out[29..33].copy_from_slice(&crc.to_be_bytes());
    out
}

fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| if crc & 1 == 1 { (crc >> 1) ^ 0xEDB8_8320 } else { crc >> 1 };
    !bytes.iter().fold(u32::MAX, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| step(crc)))
}
