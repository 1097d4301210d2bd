//! Writes the model as binary glTF.

use serde_json::{Value, json};

use crate::rig::{Influences, Rig, Values};
use crate::shape::Mesh;

const ARRAY_BUFFER: u32 = 34_962;
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;
const UNSIGNED_BYTE: u32 = 5_121;
const UNSIGNED_SHORT: u32 = 5_123;
const FLOAT: u32 = 5_126;

/// The binary chunk and the parts of the document that point into it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    fn view(&mut self, data: impl IntoIterator<Item = u8>, target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend(data);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": self.bytes.len() - offset });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// Tuples of floats with their bounds, which positions and key times must have.
    fn floats<const N: usize>(&mut self, kind: &str, values: &[[f64; N]], target: Option<u32>) -> usize {
        let values: Vec<[f32; N]> = values.iter().map(|v| v.map(|x| x as f32)).collect();
        let fold = |f: fn(f32, f32) -> f32, from: f32| {
            let bounds = values.iter().fold([from; N], |m, v| std::array::from_fn(|i| f(m[i], v[i])));
            bounds.map(f64::from).to_vec()
        };
        let (min, max) = (fold(f32::min, f32::INFINITY), fold(f32::max, f32::NEG_INFINITY));
        let view = self.view(values.iter().flatten().flat_map(|x| x.to_le_bytes()), target);
        self.accessor(
            json!({ "bufferView": view, "componentType": FLOAT, "type": kind, "count": values.len(), "min": min, "max": max }),
        )
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}

pub(crate) fn write(mesh: &Mesh, influences: &[Influences], rig: &Rig, texture: &[u8]) -> serde_json::Result<Vec<u8>> {
    let mut buffer = Buffer::default();
    let primitive = primitive(&mut buffer, mesh, influences);
    let matrices: Vec<[f64; 16]> = (0..rig.joints.len()).map(|j| rig.inverse_bind(j).to_cols_array()).collect();
    let inverse_bind = buffer.floats("MAT4", &matrices, None);
    let animations = animations(&mut buffer, rig);
    let image = buffer.view(texture.iter().copied(), None);
    let mut nodes = vec![json!({ "name": "octopus", "mesh": 0, "skin": 0 })];
    nodes.extend((0..rig.joints.len()).map(|j| joint_node(rig, j)));
    buffer.bytes.resize(buffer.bytes.len().next_multiple_of(4), 0);

    let document = json!({
        "asset": { "version": "2.0", "generator": "simpliguard generate_octopus", "copyright": "CC0 1.0" },
        "scene": 0,
        "scenes": [{ "name": "octopus", "nodes": [0, 1] }],
        "nodes": nodes,
        "meshes": [{ "name": "octopus", "primitives": [primitive] }],
        "skins": [{
            "name": "octopus",
            "skeleton": 1,
            "joints": (1..=rig.joints.len()).collect::<Vec<_>>(),
            "inverseBindMatrices": inverse_bind,
        }],
        "animations": animations,
        "materials": [{
            "name": "skin",
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 0.45 },
        }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 }],
        "images": [{ "name": "skin", "mimeType": "image/jpeg", "bufferView": image }],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
    });
    Ok(container(serde_json::to_vec(&document)?, &buffer.bytes))
}

fn primitive(buffer: &mut Buffer, mesh: &Mesh, influences: &[Influences]) -> Value {
    let column = |f: fn(&crate::shape::Vertex) -> [f64; 3]| mesh.vertices.iter().map(f).collect::<Vec<_>>();
    let positions = buffer.floats("VEC3", &column(|v| v.position.to_array()), Some(ARRAY_BUFFER));
    let normals = buffer.floats("VEC3", &column(|v| v.normal.to_array()), Some(ARRAY_BUFFER));
    let uvs: Vec<[f64; 2]> = mesh.vertices.iter().map(|v| v.uv.to_array()).collect();
    let uvs = buffer.floats("VEC2", &uvs, Some(ARRAY_BUFFER));
    let joints = buffer.view(influences.iter().flat_map(|i| i.joints), Some(ARRAY_BUFFER));
    let joints = buffer.accessor(
        json!({ "bufferView": joints, "componentType": UNSIGNED_BYTE, "type": "VEC4", "count": influences.len() }),
    );
    let weights = buffer.view(influences.iter().flat_map(|i| i.weights).flat_map(u16::to_le_bytes), Some(ARRAY_BUFFER));
    let weights = buffer.accessor(json!({
        "bufferView": weights, "componentType": UNSIGNED_SHORT, "normalized": true, "type": "VEC4", "count": influences.len(),
    }));
    let indices = mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes());
    let indices = buffer.view(indices, Some(ELEMENT_ARRAY_BUFFER));
    let indices = buffer.accessor(json!({
        "bufferView": indices, "componentType": UNSIGNED_SHORT, "type": "SCALAR", "count": 3 * mesh.triangles.len(),
    }));
    json!({
        "attributes": { "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs, "JOINTS_0": joints, "WEIGHTS_0": weights },
        "indices": indices,
        "material": 0,
    })
}

fn joint_node(rig: &Rig, joint: usize) -> Value {
    let (translation, rotation) = rig.local(joint);
    let children: Vec<usize> =
        (0..rig.joints.len()).filter(|&j| rig.joints[j].parent == Some(joint)).map(|j| j + 1).collect();
    let mut node = json!({
        "name": rig.joints[joint].name,
        "translation": translation.as_vec3().to_array(),
        "rotation": rotation.as_quat().to_array(),
    });
    if !children.is_empty() {
        node["children"] = json!(children);
    }
    node
}

fn animations(buffer: &mut Buffer, rig: &Rig) -> Vec<Value> {
    rig.clips
        .iter()
        .map(|clip| {
            let times = buffer.floats("SCALAR", &clip.times.iter().map(|&t| [t]).collect::<Vec<_>>(), None);
            let (mut samplers, mut channels) = (Vec::new(), Vec::new());
            for (sampler, channel) in clip.channels.iter().enumerate() {
                let (path, output) = match &channel.values {
                    Values::Rotation(v) => {
                        ("rotation", buffer.floats("VEC4", &v.iter().map(|q| q.to_array()).collect::<Vec<_>>(), None))
                    }
                    Values::Translation(v) => (
                        "translation",
                        buffer.floats("VEC3", &v.iter().map(|p| p.to_array()).collect::<Vec<_>>(), None),
                    ),
                };
                samplers.push(json!({ "input": times, "output": output }));
                channels.push(json!({ "sampler": sampler, "target": { "node": channel.joint + 1, "path": path } }));
            }
            json!({ "name": clip.name, "samplers": samplers, "channels": channels })
        })
        .collect()
}

/// Header, JSON chunk and binary chunk, each padded to 4 bytes.
fn container(mut json: Vec<u8>, binary: &[u8]) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let word = |n: usize| (n as u32).to_le_bytes();
    [&b"glTF"[..], &word(2), &word(total), &word(json.len()), b"JSON", &json, &word(binary.len()), b"BIN\0", binary]
        .concat()
}
