//! A glTF under construction: its JSON and its one binary chunk.

use serde_json::{Map, Value, json};

use super::fault::fault;
use crate::gltf::glb::{self, Chunks, MAX_BYTES};
use crate::{Error, StageId};

/// The use of a buffer view on the GPU.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::gltf) enum BufferTarget {
    Vertices,
    Indices,
    /// Images, animation and skin data.
    None,
}

/// The top-level arrays of a glTF that other objects refer to by index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gltf) enum Kind {
    Scene,
    Node,
    Mesh,
    Skin,
    Camera,
    Animation,
    Material,
    Texture,
    Sampler,
    Image,
    Accessor,
    BufferView,
}

impl Kind {
    pub(in crate::gltf) const ALL: [Self; 12] = [
        Self::Scene,
        Self::Node,
        Self::Mesh,
        Self::Skin,
        Self::Camera,
        Self::Animation,
        Self::Material,
        Self::Texture,
        Self::Sampler,
        Self::Image,
        Self::Accessor,
        Self::BufferView,
    ];

    pub(in crate::gltf) fn key(self) -> &'static str {
        match self {
            Self::Scene => "scenes",
            Self::Node => "nodes",
            Self::Mesh => "meshes",
            Self::Skin => "skins",
            Self::Camera => "cameras",
            Self::Animation => "animations",
            Self::Material => "materials",
            Self::Texture => "textures",
            Self::Sampler => "samplers",
            Self::Image => "images",
            Self::Accessor => "accessors",
            Self::BufferView => "bufferViews",
        }
    }
}

/// JSON and binary chunk of a glTF with all data in buffer 0.
#[derive(Clone)]
pub(in crate::gltf) struct Builder {
    /// Name of the asset, for messages.
    pub(in crate::gltf) asset: String,
    /// The document; `buffers[0]` is written by [`Self::into_glb`].
    pub(in crate::gltf) json: Map<String, Value>,
    /// Contents of buffer 0.
    pub(in crate::gltf) bin: Vec<u8>,
}

impl Builder {
    /// An empty document.
    pub(in crate::gltf) fn new(asset: &str) -> Self {
        let header = json!({ "version": "2.0" });
        Self { asset: asset.to_owned(), json: Map::from_iter([("asset".to_owned(), header)]), bin: Vec::new() }
    }

    /// A binary glTF whose buffer is its binary chunk.
    pub(in crate::gltf) fn from_glb(asset: &str, bytes: &[u8]) -> Result<Self, Error> {
        let broken = || fault(asset, "a baked file cannot be read");
        let Chunks { json, bin } = glb::split(bytes).map_err(|_| broken())?;
        let json = serde_json::from_slice(json).map_err(|_| broken())?;
        Ok(Self { asset: asset.to_owned(), json, bin: bin.unwrap_or_default().to_vec() })
    }

    /// All objects of a kind.
    pub(in crate::gltf) fn all(&self, kind: Kind) -> &[Value] {
        self.json.get(kind.key()).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }

    /// All objects of a kind. A missing array is created.
    pub(in crate::gltf) fn all_mut(&mut self, kind: Kind) -> &mut Vec<Value> {
        let slot = self.json.entry(kind.key()).or_insert_with(|| json!([]));
        if !slot.is_array() {
            *slot = json!([]);
        }
        slot.as_array_mut().expect("made an array above")
    }

    /// Appends an object and returns its index.
    pub(in crate::gltf) fn push(&mut self, kind: Kind, object: Value) -> usize {
        let all = self.all_mut(kind);
        all.push(object);
        all.len() - 1
    }

    /// Appends a buffer view at a 4-byte boundary.
    pub(in crate::gltf) fn push_view(&mut self, bytes: &[u8], target: BufferTarget) -> usize {
        let offset = append_aligned(&mut self.bin, bytes);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        match target {
            BufferTarget::Vertices => view["target"] = json!(34962),
            BufferTarget::Indices => view["target"] = json!(34963),
            BufferTarget::None => {}
        }
        self.push(Kind::BufferView, view)
    }

    /// Appends an accessor of tightly packed elements with a buffer view of its own.
    pub(in crate::gltf) fn push_accessor<T: bytemuck::NoUninit>(
        &mut self,
        elements: &[T],
        component: Component,
        shape: &str,
        target: BufferTarget,
    ) -> usize {
        let view = self.push_view(bytemuck::cast_slice(elements), target);
        let accessor =
            json!({ "bufferView": view, "componentType": component as u32, "count": elements.len(), "type": shape });
        self.push(Kind::Accessor, accessor)
    }

    /// Declares an extension as used, once.
    pub(in crate::gltf) fn use_extension(&mut self, name: &str) {
        let used = self.json.entry("extensionsUsed").or_insert_with(|| json!([]));
        if let Some(used) = used.as_array_mut()
            && !used.iter().any(|u| u == name)
        {
            used.push(json!(name));
        }
    }

    /// Index of the default scene.
    pub(in crate::gltf) fn default_scene(&self) -> usize {
        self.json.get("scene").and_then(Value::as_u64).unwrap_or(0) as usize
    }

    /// Writes the version of simpliguard to `asset.generator`. Copyright and other properties stay.
    pub(in crate::gltf) fn stamp(&mut self, version: &str) {
        let asset = self.json.entry("asset").or_insert_with(|| json!({ "version": "2.0" }));
        if let Some(asset) = asset.as_object_mut() {
            asset.insert("generator".into(), json!(format!("simpliguard {version}")));
        }
    }

    /// The binary glTF.
    pub(in crate::gltf) fn into_glb(mut self) -> Result<Vec<u8>, Error> {
        self.json.remove("buffers");
        if !self.bin.is_empty() {
            self.json.insert("buffers".into(), json!([{ "byteLength": self.bin.len() }]));
        }
        self.json.retain(|_, value| !matches!(value, Value::Array(all) if all.is_empty()));
        glb::binary(&Value::Object(self.json), &self.bin).map_err(|found| Error::Limit {
            asset: self.asset,
            stage: StageId::Export,
            what: "size of the binary glTF in bytes".into(),
            found,
            limit: MAX_BYTES,
        })
    }
}

/// glTF component types.
#[derive(Clone, Copy)]
#[repr(u32)]
pub(in crate::gltf) enum Component {
    U8 = 5121,
    U16 = 5123,
    U32 = 5125,
    F32 = 5126,
}

/// Appends `bytes` at the next multiple of four; returns that offset.
pub(in crate::gltf) fn append_aligned(bin: &mut Vec<u8>, bytes: &[u8]) -> usize {
    let offset = bin.len().next_multiple_of(4);
    bin.resize(offset, 0);
    bin.extend_from_slice(bytes);
    offset
}

/// A non-negative integer member of a JSON object.
pub(in crate::gltf) fn index(object: &Value, key: &str) -> Option<usize> {
    object.get(key).and_then(Value::as_u64).and_then(|i| usize::try_from(i).ok())
}

/// The indices in an array member of a JSON object.
pub(in crate::gltf) fn indices<'a>(object: &'a Value, key: &str) -> impl Iterator<Item = usize> + use<'a> {
    let all = object.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    all.iter().filter_map(Value::as_u64).filter_map(|i| usize::try_from(i).ok())
}

/// A factor with the shortest decimal digits that give the same `f32`.
pub(in crate::gltf) fn number(x: f32) -> Value {
    x.to_string().parse::<f64>().map_or(Value::Null, Value::from)
}
