//! The vertices of a level as glTF attributes.

use std::num::TryFromIntError;

use glam::{Vec2, Vec3, Vec4};
use serde_json::{Map, Value, json};

use super::builder::{BufferTarget, Builder, Component, Kind};
use crate::data::{Influences, LevelMesh, LevelMorph, Material, bounds};

/// Vertices as they are written: in bind space if skinned, else in world space.
pub(super) struct Vertices {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) tangents: Vec<Vec4>,
    pub(super) uvs: Vec<Vec2>,
    /// Empty for a level with an atlas of its own.
    pub(super) second_uvs: Vec<Vec2>,
    /// Empty for a level with textures of its own.
    pub(super) colors: Vec<Vec4>,
    /// Joints of the skin and weights as glTF requires them: no joint twice, unused slots zero, weights of sum one.
    /// Empty if the level is static.
    pub(super) influences: Vec<Influences>,
    pub(super) morphs: Vec<LevelMorph>,
}

impl Vertices {
    /// The vertices of a static level.
    pub(super) fn in_world(mesh: &LevelMesh) -> Self {
        Self {
            positions: mesh.positions.clone(),
            normals: mesh.normals.iter().map(|n| n.normalize_or(Vec3::Y)).collect(),
            tangents: mesh.tangents.iter().map(|t| t.truncate().normalize_or_zero().extend(t.w)).collect(),
            uvs: mesh.uvs.clone(),
            second_uvs: mesh.second_uvs.clone(),
            colors: mesh.colors.clone(),
            influences: Vec::new(),
            morphs: mesh.morphs.clone(),
        }
    }

    /// Subtracts the effect of the morph targets at their default `weights`: a loader adds it again.
    pub(super) fn subtract_morphs(&mut self, weights: impl Iterator<Item = f32>) {
        for (morph, weight) in self.morphs.iter().zip(weights).filter(|(_, weight)| *weight != 0.0) {
            self.positions.iter_mut().zip(&morph.positions).for_each(|(p, offset)| *p -= *offset * weight);
            self.normals.iter_mut().zip(&morph.normals).for_each(|(n, offset)| *n -= *offset * weight);
        }
        if !self.morphs.is_empty() {
            self.normals.iter_mut().for_each(|n| *n = n.normalize_or(Vec3::Y));
        }
    }

    /// Rounds the handedness of the tangents to -1 or 1.
    pub(super) fn round_handedness(&mut self) {
        for tangent in &mut self.tangents {
            tangent.w = if tangent.w < 0.0 { -1.0 } else { 1.0 };
        }
    }

    /// The vertices with the old indices `order`, in that order.
    pub(super) fn reordered(&self, order: &[u32]) -> Self {
        fn take<T: Copy>(all: &[T], order: &[u32]) -> Vec<T> {
            if all.is_empty() { Vec::new() } else { order.iter().map(|&v| all[v as usize]).collect() }
        }
        let morph =
            |m: &LevelMorph| LevelMorph { positions: take(&m.positions, order), normals: take(&m.normals, order) };
        Self {
            positions: take(&self.positions, order),
            normals: take(&self.normals, order),
            tangents: take(&self.tangents, order),
            uvs: take(&self.uvs, order),
            second_uvs: take(&self.second_uvs, order),
            colors: take(&self.colors, order),
            influences: take(&self.influences, order),
            morphs: self.morphs.iter().map(morph).collect(),
        }
    }

    /// Gives a direction to the tangents that have none.
    pub(super) fn complete_tangents(&mut self) {
        for tangent in &mut self.tangents {
            *tangent = tangent.truncate().normalize_or(Vec3::X).extend(tangent.w);
        }
    }

    /// Leaves out what only other layers use: attributes of the source's materials.
    pub(super) fn drop_kept(&mut self) {
        self.colors.clear();
        self.second_uvs.clear();
        if self.tangents.iter().all(|tangent| tangent.truncate() == Vec3::ZERO) {
            self.tangents.clear();
        }
    }

    /// Leaves out what says nothing: attributes that the source's primitive did not have, or its material does not use.
    pub(super) fn drop_defaults(&mut self, material: &Material) {
        if material.normal_texture.is_none() || self.tangents.iter().any(|t| t.truncate() == Vec3::ZERO) {
            self.tangents.clear();
        }
        if self.colors.iter().all(|color| *color == Vec4::ONE) {
            self.colors.clear();
        }
        if self.second_uvs.iter().all(|uv| *uv == Vec2::ZERO) {
            self.second_uvs.clear();
        }
    }

    /// Appends the accessors; returns the primitive's `attributes`.
    pub(super) fn write(&self, out: &mut Builder) -> Value {
        let mut attributes = Map::new();
        let mut add = |name: &str, accessor: usize| attributes.insert(name.into(), json!(accessor));
        add("POSITION", push_positions(out, &self.positions));
        add("NORMAL", out.push_accessor(&self.normals, Component::F32, "VEC3", BufferTarget::Vertices));
        if !self.tangents.is_empty() {
            add("TANGENT", out.push_accessor(&self.tangents, Component::F32, "VEC4", BufferTarget::Vertices));
        }
        add("TEXCOORD_0", out.push_accessor(&self.uvs, Component::F32, "VEC2", BufferTarget::Vertices));
        if !self.second_uvs.is_empty() {
            add("TEXCOORD_1", out.push_accessor(&self.second_uvs, Component::F32, "VEC2", BufferTarget::Vertices));
        }
        if !self.colors.is_empty() {
            add("COLOR_0", out.push_accessor(&self.colors, Component::F32, "VEC4", BufferTarget::Vertices));
        }
        if !self.influences.is_empty() {
            add("JOINTS_0", self.push_joints(out));
            let weights: Vec<[f32; 4]> = self.influences.iter().map(|i| i.weights).collect();
            add("WEIGHTS_0", out.push_accessor(&weights, Component::F32, "VEC4", BufferTarget::Vertices));
        }
        Value::Object(attributes)
    }

    /// Appends the accessors of the morph targets; returns the primitive's `targets`.
    pub(super) fn write_morphs(&self, out: &mut Builder) -> Value {
        let mut target = |morph: &LevelMorph| {
            json!({
                "POSITION": push_positions(out, &morph.positions),
                "NORMAL": out.push_accessor(&morph.normals, Component::F32, "VEC3", BufferTarget::Vertices),
            })
        };
        self.morphs.iter().map(&mut target).collect()
    }

    /// Appends the joints: as bytes if they fit, else as 16-bit numbers.
    fn push_joints(&self, out: &mut Builder) -> usize {
        let bytes: Result<Vec<[u8; 4]>, _> = self.influences.iter().map(|i| bytes_of(i.joints)).collect();
        match bytes {
            Ok(bytes) => out.push_accessor(&bytes, Component::U8, "VEC4", BufferTarget::Vertices),
            Err(_) => {
                let shorts: Vec<[u16; 4]> = self.influences.iter().map(|i| i.joints).collect();
                out.push_accessor(&shorts, Component::U16, "VEC4", BufferTarget::Vertices)
            }
        }
    }
}

/// Appends positions with the bounds that glTF requires.
fn push_positions(out: &mut Builder, positions: &[Vec3]) -> usize {
    let accessor = out.push_accessor(positions, Component::F32, "VEC3", BufferTarget::Vertices);
    let (low, high) = bounds(positions);
    let bounds = &mut out.all_mut(Kind::Accessor)[accessor];
    bounds["min"] = json!(low.to_array());
    bounds["max"] = json!(high.to_array());
    accessor
}

fn bytes_of(joints: [u16; 4]) -> Result<[u8; 4], TryFromIntError> {
    let mut out = [0; 4];
    for (byte, joint) in out.iter_mut().zip(joints) {
        *byte = u8::try_from(joint)?;
    }
    Ok(out)
}
