//! The village as one glTF file, as a level designer would export it: 300 nodes, 20 meshes, one material.

use std::f32::consts::TAU;
use std::path::Path;
use std::{fs, io};

use bevy::math::{Quat, Vec2, Vec3};
use bevy::prelude::Component;
use serde_json::{Value, json};

use super::shapes::{Kind, Shape, chance, kinds};

/// Radius of the village in metres.
pub(crate) const RADIUS: f32 = 62.0;

/// What the levels of a village stand for. There is a file for each.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LevelsOf {
    /// Each object has levels. The smallest share their textures, and two stand for all objects.
    Objects,
    /// The whole file has levels, as by default.
    File,
}

impl LevelsOf {
    /// The name of the file.
    pub(crate) const fn file(self) -> &'static str {
        match self {
            Self::Objects => "village.glb",
            Self::File => "village_one_level.glb",
        }
    }

    /// The settings of the file: what makes the difference, and what makes the first start quick.
    fn meta(self) -> String {
        let own = match self {
            Self::Objects => "scope: Objects, candidates: Source, whole: [1000, 4000], shared_atlas: 1024",
            Self::File => "faces: [1000, 4000]",
        };
        format!(
            r#"(
    meta_format_version: "1.0",
    asset: Process(
        processor: "bevy_simpliguard::SimpliguardProcess",
        settings: (
            {own},
            quality: Draft,
            texture_size: 256,
            views: 16,
            view_size: 256,
        ),
    ),
)
"#
        )
    }
}

/// Writes a file and its settings into a folder. What is there already stays as it is.
pub(crate) fn write(folder: &Path, levels: LevelsOf) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let file = levels.file();
    for (name, content) in [(file.to_owned(), glb()?), (format!("{file}.meta"), levels.meta().into_bytes())] {
        let path = folder.join(name);
        if !fs::read(&path).is_ok_and(|there| there == content) {
            fs::write(path, content)?;
        }
    }
    Ok(())
}

#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    fn vectors(&mut self, vectors: &[Vec3], is_position: bool) -> usize {
        let mut accessor = json!({ "componentType": 5126, "type": "VEC3", "count": vectors.len() });
        if is_position {
            let bounds = vectors.iter().fold((Vec3::MAX, Vec3::MIN), |(low, high), p| (low.min(*p), high.max(*p)));
            accessor["min"] = json!(bounds.0.to_array());
            accessor["max"] = json!(bounds.1.to_array());
        }
        let bytes = vectors.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes);
        self.add(bytes, accessor)
    }

    fn indices(&mut self, triangles: &[[u32; 3]]) -> usize {
        let accessor = json!({ "componentType": 5125, "type": "SCALAR", "count": 3 * triangles.len() });
        self.add(triangles.iter().flatten().flat_map(|i| i.to_le_bytes()), accessor)
    }

    fn add(&mut self, bytes: impl IntoIterator<Item = u8>, mut accessor: Value) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": self.bytes.len() - offset }));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn mesh(&mut self, name: &str, shape: &Shape) -> Value {
        let attributes = json!({
            "POSITION": self.vectors(&shape.positions, true), "NORMAL": self.vectors(&shape.normals, false),
            "COLOR_0": self.vectors(&shape.colors, false),
        });
        let indices = self.indices(&shape.triangles);
        json!({ "name": name, "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }] })
    }
}

/// Places for all objects: the large ones first, each where it has room.
fn nodes(kinds: &[Kind]) -> Vec<Value> {
    let mut taken: Vec<(Vec2, f32)> = Vec::new();
    let mut nodes = Vec::new();
    for (mesh, kind) in kinds.iter().enumerate() {
        for i in 0..kind.count {
            let place = |attempt: u32| {
                let seed = 7919 * mesh as u32 + 131 * i + 17 * attempt;
                let (turn, away) = (TAU * chance(seed), RADIUS * chance(seed + 1).sqrt());
                Vec2::from_angle(turn) * away
            };
            let is_free = |at: &Vec2| taken.iter().all(|(other, room)| other.distance(*at) > 0.5 * (room + kind.room));
            let at = (0..500).map(place).find(is_free).unwrap_or_else(|| place(0));
            taken.push((at, kind.room));
            let seed = 104_729 * mesh as u32 + i;
            let (turn, scale) = (Quat::from_rotation_y(TAU * chance(seed)), 0.85 + 0.3 * chance(seed + 1));
            nodes.push(json!({
                "name": format!("{}.{i:03}", kind.name), "mesh": mesh, "translation": [at.x, 0.0, at.y],
                "rotation": turn.to_array(), "scale": [scale, scale, scale],
            }));
        }
    }
    nodes
}

fn glb() -> io::Result<Vec<u8>> {
    let (kinds, mut buffer) = (kinds(), Buffer::default());
    let meshes: Vec<Value> = kinds.iter().map(|kind| buffer.mesh(&kind.name, &kind.shape)).collect();
    let nodes = nodes(&kinds);
    let json = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "materials": [{ "name": "painted", "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.9 } }],
        "nodes": nodes, "meshes": meshes, "bufferViews": buffer.views, "accessors": buffer.accessors,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
    });
    let mut text = serde_json::to_vec(&json)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    let lengths =
        [28 + text.len() + buffer.bytes.len(), text.len(), buffer.bytes.len()].map(|n| (n as u32).to_le_bytes());
    out.extend(lengths[0]);
    out.extend([&lengths[1], &b"JSON"[..], &text, &lengths[2], b"BIN\0", &buffer.bytes].concat());
    Ok(out)
}
