//! How vertices move with their bones, from the rest pose to a frame of a clip.

use glam::{Affine3A, DMat3, DMat4};
use rayon::prelude::*;

use crate::mesh::DisjointSets;
use crate::model::{Influences, Model, Pose, Rig};

/// Smallest determinant at which a blend of joints is inverted, relative to the size of the matrix.
const MIN_DETERMINANT: f64 = 1e-9;

/// Linear blend skinning of a rig, as its levels are written.
pub struct Skinning<'a> {
    rig: &'a Rig,
    /// From the space that a bone's vertices are blended in to the joint.
    bind: Vec<DMat4>,
    /// From that space to the world in the rest pose.
    rest: Vec<DMat4>,
}

impl<'a> Skinning<'a> {
    /// The skinning of a model; `None` if it has no bones.
    pub fn of(model: &'a Model) -> Option<Self> {
        let rig = model.rig.as_ref()?;
        let mut spaces = bind_spaces(rig, &model.surface.influences);
        let bind: Vec<DMat4> = (0..rig.bones.len())
            .map(|bone| {
                let inverse_bind = rig.bones[bone].inverse_bind.as_dmat4();
                // The only skin is taken over as it is; others are rebased onto the world.
                if rig.source_skin.is_some() {
                    inverse_bind
                } else {
                    inverse_bind * to_bind_space(rig, spaces.find(bone))
                }
            })
            .collect();
        let rest = rig.bones.iter().zip(&bind).map(|(bone, bind)| bone.rest_world.as_dmat4() * *bind).collect();
        Some(Self { rig, bind, rest })
    }

    /// The frames of the source's clips.
    pub fn poses(&self) -> &'a [Pose] {
        &self.rig.poses
    }

    /// From the rest pose to `pose` for each vertex. A vertex whose rest matrix has no inverse stays where it is.
    pub fn motions(&self, pose: &Pose, influences: &[Influences]) -> Vec<Affine3A> {
        let posed: Vec<DMat4> =
            pose.world.iter().zip(&self.bind).map(|(world, bind)| world.as_dmat4() * *bind).collect();
        influences.par_iter().with_min_len(256).map(|influences| self.motion(&posed, influences)).collect()
    }

    fn motion(&self, posed: &[DMat4], influences: &Influences) -> Affine3A {
        let rest = blend(&self.rest, influences);
        if !is_invertible(&rest) {
            return Affine3A::IDENTITY;
        }
        let motion = (blend(posed, influences) * rest.inverse()).as_mat4();
        if motion.is_finite() { Affine3A::from_mat4(motion) } else { Affine3A::IDENTITY }
    }
}

fn blend(matrices: &[DMat4], influences: &Influences) -> DMat4 {
    let slots = influences.joints.iter().zip(influences.weights).filter(|(_, weight)| *weight > 0.0);
    slots.fold(DMat4::ZERO, |sum, (&joint, weight)| sum + matrices[usize::from(joint)] * f64::from(weight))
}

/// Whether a matrix keeps volume, relative to its size.
pub(crate) fn is_invertible(m: &DMat4) -> bool {
    let linear = DMat3::from_mat4(*m);
    let size = linear.x_axis.length().max(linear.y_axis.length()).max(linear.z_axis.length());
    let determinant = linear.determinant().abs();
    m.is_finite() && determinant > MIN_DETERMINANT * size.powi(3)
}

/// Bones that share vertices of the source, and with them a bind space, each set under its first bone.
pub(crate) fn bind_spaces(rig: &Rig, source: &[Influences]) -> DisjointSets {
    let mut sets = DisjointSets::new(rig.bones.len());
    for influences in source {
        for (&joint, &weight) in influences.joints.iter().zip(&influences.weights).skip(1) {
            let (a, b) = (influences.joints[0] as usize, joint as usize);
            if weight > 0.0 && a.max(b) < rig.bones.len() {
                sets.join(a, b);
            }
        }
    }
    sets
}

/// From the world to the bind space of `bone`, which it is the first of; the identity if that has no volume.
pub(crate) fn to_bind_space(rig: &Rig, bone: usize) -> DMat4 {
    let bone = &rig.bones[bone];
    let space = bone.rest_world.as_dmat4() * bone.inverse_bind.as_dmat4();
    if is_invertible(&space) { space.inverse() } else { DMat4::IDENTITY }
}
