//! Combined files of a few triangles.

use serde_json::{Value, json};

/// A glTF with one buffer.
pub(super) struct Glb {
    pub(super) json: Value,
    bin: Vec<u8>,
}

impl Glb {
    pub(super) fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "scene": 0, "materials": [{}, {}], "bufferViews": [], "accessors": [],
            "meshes": [], "extensionsUsed": ["MSFT_lod"],
        });
        Self { json, bin: Vec::new() }
    }

    pub(super) fn set(mut self, key: &str, value: Value) -> Self {
        self.json[key] = value;
        self
    }

    /// Appends a mesh of `triangles` triangles between `min` and `max`, with a material.
    pub(super) fn mesh(mut self, (min, max): ([f32; 3], [f32; 3]), triangles: usize, material: usize) -> Self {
        let attributes = self.corners(min, max, triangles);
        self.push_mesh(attributes, material)
    }

    /// Appends such a mesh with all its vertices on joint 0.
    pub(super) fn skinned_mesh(mut self, (min, max): ([f32; 3], [f32; 3]), triangles: usize, material: usize) -> Self {
        let mut attributes = self.corners(min, max, triangles);
        let joints = vec![0_u8; 12 * triangles];
        attributes["JOINTS_0"] = self.accessor(&joints, json!({ "componentType": 5121, "type": "VEC4" }), 4);
        let weights = [1.0_f32, 0.0, 0.0, 0.0].repeat(3 * triangles);
        attributes["WEIGHTS_0"] = self.accessor(&le(&weights), json!({ "componentType": 5126, "type": "VEC4" }), 16);
        self.push_mesh(attributes, material)
    }

    /// Appends such a mesh with morph targets: each moves all its vertices by one of `moves`.
    pub(super) fn morphing_mesh(
        mut self,
        (min, max): ([f32; 3], [f32; 3]),
        triangles: usize,
        material: usize,
        moves: &[[f32; 3]],
    ) -> Self {
        let attributes = self.corners(min, max, triangles);
        let mut target = |by: &[f32; 3]| {
            let about = json!({ "componentType": 5126, "type": "VEC3", "min": by, "max": by });
            json!({ "POSITION": self.accessor(&le(&by.repeat(3 * triangles)), about, 12) })
        };
        let targets: Vec<Value> = moves.iter().map(&mut target).collect();
        self = self.push_mesh(attributes, material);
        let mesh = self.json["meshes"].as_array_mut().and_then(|meshes| meshes.last_mut()).expect("a mesh");
        mesh["primitives"][0]["targets"] = json!(targets);
        mesh["weights"] = json!(vec![0.25; moves.len()]);
        self
    }

    fn corners(&mut self, min: [f32; 3], max: [f32; 3], triangles: usize) -> Value {
        let corners = [min, [max[0], min[1], max[2]], max].concat().repeat(triangles);
        let about = json!({ "componentType": 5126, "type": "VEC3", "min": min, "max": max });
        let positions = self.accessor(&le(&corners), about, 12);
        let normals = [0.0_f32, 0.0, 1.0].repeat(3 * triangles);
        let normals = self.accessor(&le(&normals), json!({ "componentType": 5126, "type": "VEC3" }), 12);
        json!({ "POSITION": positions, "NORMAL": normals })
    }

    fn push_mesh(mut self, attributes: Value, material: usize) -> Self {
        let mesh = json!({ "primitives": [{ "attributes": attributes, "material": material }] });
        self.json["meshes"].as_array_mut().expect("a list").push(mesh);
        self
    }

    fn accessor(&mut self, bytes: &[u8], mut about: Value, size: usize) -> Value {
        let push = |list: &mut Value, item: Value| {
            let list = list.as_array_mut().expect("a list");
            list.push(item);
            list.len() - 1
        };
        let view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        about["bufferView"] = json!(push(&mut self.json["bufferViews"], view));
        about["count"] = json!(bytes.len() / size);
        json!(push(&mut self.json["accessors"], about))
    }

    pub(super) fn bytes(mut self) -> Vec<u8> {
        self.json["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let glb = gltf::Glb {
            header: gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 },
            json: self.json.to_string().into_bytes().into(),
            bin: Some(self.bin.into()),
        };
        glb.to_vec().expect("a small file")
    }
}

/// A level node as the export writes it.
pub(super) fn level(level: u32, mesh: usize, error: f32, replaces: &[usize]) -> Value {
    let budget = 10 * level;
    let stamp = json!({
        "version": "1", "level": level, "budget": budget, "faces": level, "error": error, "replaces": replaces,
    });
    json!({ "name": format!("LOD{level}"), "mesh": mesh, "extras": { "simpliguard": stamp } })
}

fn le(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}
