//! The skin of the levels: its joints, and the levels' vertices in its bind space.
//!
//! A level arrives in the rest pose. A skinned vertex is written at `p_bind = (sum w_j W_j B_j)^-1 p_world` with the
//! joints' rest matrices `W` and inverse bind matrices `B`, so that skinning it in the rest pose gives `p_world` back,
//! whether or not the source's rest pose is its bind pose.
//!
//! The levels of a source with one skin reuse that skin unchanged. Otherwise the bones in use become one merged skin,
//! with one joint per node. Bones that share vertices of the source share a bind space `X`, which may be rotated or in
//! other units. Each space is rebased onto the world, `B' = B S^-1` with `S = W B` of its first bone, so that bones of
//! different spaces blend. Within a space the motion stays exact. Two spaces of one node may still differ after that,
//! if the rest pose is not the bind pose; the first one is then used.

use glam::{DMat3, DMat4, Mat4, Vec3};
use serde_json::json;

use super::builder::{BufferTarget, Builder, Component, Kind};
use super::fault::fault;
use super::hierarchy;
use super::vertices::Vertices;
use crate::animation::{bind_spaces, is_invertible, to_bind_space};
use crate::data::{Bone, Influences, Level, LevelMesh, LevelMorph, Model, Rig};
use crate::{Error, StageId};

/// Largest number of joints of a merged skin: engines hold 256 matrices.
const MAX_JOINTS: usize = 256;

/// The skin that is written, and its joint for each bone of the rig.
pub(super) struct Binding {
    /// Index of the source's skin, if it is reused.
    source: Option<usize>,
    joints: Vec<Joint>,
    /// Joint of each bone of the rig. A merged skin has no joint for bones that no level uses.
    joint_of_bone: Vec<Option<u16>>,
}

#[derive(Clone)]
struct Joint {
    node: usize,
    inverse_bind: Mat4,
    /// From bind space to the world in the rest pose.
    rest: DMat4,
}

impl Joint {
    fn new(node: usize, inverse_bind: Mat4, rest_world: Mat4) -> Self {
        Self { node, inverse_bind, rest: rest_world.as_dmat4() * inverse_bind.as_dmat4() }
    }
}

impl Binding {
    /// The skin for `levels`; `None` if none of them is skinned.
    pub(super) fn new(model: &Model, levels: &[Level]) -> Result<Option<Self>, Error> {
        let Some(rig) = model.rig.as_ref().filter(|_| levels.iter().any(|l| !l.mesh.influences.is_empty())) else {
            return Ok(None);
        };
        let binding = match rig.source_skin {
            Some(skin) => Self::reused(rig, skin),
            None => Self::merged(rig, &used_bones(rig, levels), &model.surface.influences),
        };
        if binding.is_merged() && binding.joints.len() > MAX_JOINTS {
            return Err(Error::invalid(
                &model.name,
                StageId::Export,
                format!("the levels use {} joints, and engines support {MAX_JOINTS}", binding.joints.len()),
                "split the model into files of fewer moving parts",
            ));
        }
        Ok(Some(binding))
    }

    /// The source's skin as it is.
    fn reused(rig: &Rig, skin: usize) -> Self {
        let joint = |bone: &Bone| Joint::new(bone.node, bone.inverse_bind, bone.rest_world);
        Self {
            source: Some(skin),
            joints: rig.bones.iter().map(joint).collect(),
            joint_of_bone: (0..rig.bones.len()).map(|b| u16::try_from(b).ok()).collect(),
        }
    }

    /// One joint for each node of the bones in use.
    fn merged(rig: &Rig, used: &[bool], source: &[Influences]) -> Self {
        let mut out = Self { source: None, joints: Vec::new(), joint_of_bone: vec![None; rig.bones.len()] };
        let spaces = bind_spaces(rig, source);
        for (b, bone) in rig.bones.iter().enumerate().filter(|&(b, _)| used[b]) {
            let same_node = out.joints.iter().position(|j| j.node == bone.node);
            if same_node.is_none() {
                let to_space = to_bind_space(rig, spaces[b]);
                let inverse_bind = affine((bone.inverse_bind.as_dmat4() * to_space).as_mat4());
                out.joints.push(Joint::new(bone.node, inverse_bind, bone.rest_world));
            }
            out.joint_of_bone[b] = u16::try_from(same_node.unwrap_or(out.joints.len() - 1)).ok();
        }
        out
    }

    /// The skin with only the joints that `level` uses; `None` if the level shares the skin of all levels.
    pub(super) fn narrowed(&self, level: &Level) -> Option<Self> {
        if !level.own_joints || level.mesh.influences.is_empty() {
            return None;
        }
        let mut used = vec![false; self.joints.len()];
        for influences in level.mesh.influences.iter().map(|i| self.joints_of(i)) {
            let slots = influences.joints.iter().zip(influences.weights).filter(|(_, weight)| *weight > 0.0);
            slots.for_each(|(&joint, _)| used[usize::from(joint)] = true);
        }
        let place: Vec<u16> =
            used.iter().scan(0, |next, &used| Some(std::mem::replace(next, *next + u16::from(used)))).collect();
        let kept = |joint: u16| used[usize::from(joint)].then(|| place[usize::from(joint)]);
        Some(Self {
            source: None,
            joints: self.joints.iter().zip(&used).filter(|(_, used)| **used).map(|(joint, _)| joint.clone()).collect(),
            joint_of_bone: self.joint_of_bone.iter().map(|joint| joint.and_then(kept)).collect(),
        })
    }

    /// True if the skin is made here, from several skins of the source or from moving mesh nodes.
    pub(super) fn is_merged(&self) -> bool {
        self.source.is_none()
    }

    /// The joints' nodes in the source's document.
    pub(super) fn nodes(&self) -> impl Iterator<Item = usize> {
        self.joints.iter().map(|j| j.node)
    }

    /// Gives the joints of a merged skin the common root that glTF requires, in scene `scene`. A skin of the source has
    /// one.
    pub(super) fn join_roots(&self, out: &mut Builder, scene: usize) {
        let joints: Vec<usize> = self.nodes().collect();
        if self.is_merged() && !hierarchy::have_common_root(out, &hierarchy::scene_roots(out, scene), &joints) {
            hierarchy::join_roots(out, scene);
        }
    }

    /// Index of the skin on the source's nodes. It is appended unless it is the source's own.
    pub(super) fn write(&self, out: &mut Builder) -> usize {
        if let Some(skin) = self.source.filter(|&s| s < out.all(Kind::Skin).len()) {
            return skin;
        }
        let matrices: Vec<[f32; 16]> = self.joints.iter().map(|j| j.inverse_bind.to_cols_array()).collect();
        let matrices = out.push_accessor(&matrices, Component::F32, "MAT4", BufferTarget::None);
        let joints: Vec<usize> = self.nodes().collect();
        out.push(Kind::Skin, json!({ "joints": joints, "inverseBindMatrices": matrices }))
    }

    /// Transforms a level from the rest pose to bind space.
    pub(super) fn bind(&self, mesh: &LevelMesh) -> Vertices {
        let mut out = Vertices {
            positions: Vec::with_capacity(mesh.positions.len()),
            normals: Vec::with_capacity(mesh.normals.len()),
            tangents: Vec::with_capacity(mesh.tangents.len()),
            uvs: mesh.uvs.clone(),
            second_uvs: mesh.second_uvs.clone(),
            colors: mesh.colors.clone(),
            influences: Vec::with_capacity(mesh.influences.len()),
            morphs: vec![LevelMorph::default(); mesh.morphs.len()],
        };
        for (v, influences) in mesh.influences.iter().enumerate() {
            let (influences, rest, inverse) = self.invertible(self.joints_of(influences));
            out.positions.push(inverse.transform_point3(mesh.positions[v].as_dvec3()).as_vec3());
            let linear = DMat3::from_mat4(rest);
            let bound = |normal: Vec3| {
                let normal = (linear.transpose() * normal.as_dvec3()).normalize_or_zero().as_vec3();
                normal.normalize_or(Vec3::Y)
            };
            out.normals.push(bound(mesh.normals[v]));
            for (out, morph) in out.morphs.iter_mut().zip(&mesh.morphs) {
                out.positions.push(inverse.transform_vector3(morph.positions[v].as_dvec3()).as_vec3());
                out.normals.push(bound(mesh.normals[v] + morph.normals[v]) - bound(mesh.normals[v]));
            }
            if let Some(tangent) = mesh.tangents.get(v) {
                let direction = inverse.transform_vector3(tangent.truncate().as_dvec3()).normalize_or_zero().as_vec3();
                out.tangents.push(direction.extend(tangent.w));
            }
            out.influences.push(influences);
        }
        out
    }

    /// A vertex's bones as joints of the skin: equal joints are merged, weights descend and sum to one.
    fn joints_of(&self, bones: &Influences) -> Influences {
        let mut slots: Vec<(u16, f32)> = Vec::with_capacity(4);
        for (&bone, &weight) in bones.joints.iter().zip(&bones.weights) {
            let Some(joint) = self.joint_of_bone.get(bone as usize).copied().flatten() else { continue };
            match slots.iter_mut().find(|(j, _)| *j == joint) {
                _ if weight.is_nan() || weight <= 0.0 => {}
                Some((_, sum)) => *sum += weight,
                None => slots.push((joint, weight)),
            }
        }
        let sum: f32 = slots.iter().map(|(_, w)| w).sum();
        if sum <= 0.0 || !sum.is_finite() {
            let joint = self.joint_of_bone.get(bones.joints[0] as usize).copied().flatten();
            return Influences::rigid(joint.unwrap_or(0));
        }
        slots.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let mut out = Influences::default();
        for (i, (joint, weight)) in slots.into_iter().enumerate() {
            out.joints[i] = joint;
            out.weights[i] = weight / sum;
        }
        out
    }

    /// The influences with their rest matrix and its inverse. A singular blend is replaced by its joint of largest
    /// weight, and a singular joint by the identity.
    fn invertible(&self, influences: Influences) -> (Influences, DMat4, DMat4) {
        for candidate in [influences, Influences::rigid(influences.joints[0])] {
            let rest = self.rest(&candidate);
            if is_invertible(&rest) {
                return (candidate, rest, rest.inverse());
            }
        }
        (Influences::rigid(influences.joints[0]), DMat4::IDENTITY, DMat4::IDENTITY)
    }

    fn rest(&self, influences: &Influences) -> DMat4 {
        let mut sum = DMat4::ZERO;
        for (&joint, &weight) in influences.joints.iter().zip(&influences.weights) {
            sum += self.joints[joint as usize].rest * f64::from(weight);
        }
        sum
    }
}

fn used_bones(rig: &Rig, levels: &[Level]) -> Vec<bool> {
    let mut used = vec![false; rig.bones.len()];
    for influences in levels.iter().flat_map(|l| &l.mesh.influences) {
        for (i, (&bone, &weight)) in influences.joints.iter().zip(&influences.weights).enumerate() {
            // A vertex without weights is bound to its first bone.
            if let Some(slot) = used.get_mut(bone as usize).filter(|_| weight > 0.0 || i == 0) {
                *slot = true;
            }
        }
    }
    used
}

/// The matrix with a last row of exactly (0, 0, 0, 1), as glTF requires of inverse bind matrices.
fn affine(m: Mat4) -> Mat4 {
    Mat4::from_cols(
        m.x_axis.truncate().extend(0.0),
        m.y_axis.truncate().extend(0.0),
        m.z_axis.truncate().extend(0.0),
        m.w_axis.truncate().extend(1.0),
    )
}

/// `Err` if an influence of a level names no bone.
pub(super) fn check_influences(model: &Model, level: &Level) -> Result<(), Error> {
    let bones = model.rig.as_ref().map_or(0, |r| r.bones.len());
    let outside = level.mesh.influences.iter().flat_map(|i| i.joints).find(|&j| j as usize >= bones);
    match outside {
        Some(joint) => Err(fault(&model.name, format!("a level uses bone {joint} of {bones}"))),
        None => Ok(()),
    }
}
