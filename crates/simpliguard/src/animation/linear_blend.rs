//! How vertices move with their bones, from the rest pose to a frame of a clip.

use glam::{Affine3A, DMat3, DMat4, Vec3};
use rayon::prelude::*;

use crate::data::{Influences, Model, Pose, Rig};
use crate::geometry::DisjointSets;

/// Smallest determinant at which a blend of joints is inverted, relative to the size of the matrix.
const MIN_DETERMINANT: f64 = 1e-9;

/// Linear blend skinning of a rig, as its levels are written.
pub struct LinearBlend<'a> {
    rig: &'a Rig,
    /// From the space that a bone's vertices are blended in to the joint.
    bind: Vec<DMat4>,
    /// From that space to the world in the rest pose.
    rest: Vec<DMat4>,
}

impl<'a> LinearBlend<'a> {
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

    /// From the space that vertices are blended in to the world in `pose`, for each bone.
    pub fn bones(&self, pose: &Pose) -> Vec<DMat4> {
        pose.world.iter().zip(&self.bind).map(|(world, bind)| world.as_dmat4() * *bind).collect()
    }

    /// From the rest pose to the one of `bones` for each vertex. A vertex whose rest matrix has no inverse stays where
    /// it is.
    pub fn motions(&self, bones: &[DMat4], influences: &[Influences]) -> Vec<Affine3A> {
        influences.par_iter().with_min_len(256).map(|influences| self.motion(bones, influences)).collect()
    }

    fn motion(&self, bones: &[DMat4], influences: &Influences) -> Affine3A {
        let rest = blend(&self.rest, influences);
        if !is_invertible(&rest) {
            return Affine3A::IDENTITY;
        }
        let motion = (blend(bones, influences) * rest.inverse()).as_mat4();
        if motion.is_finite() { Affine3A::from_mat4(motion) } else { Affine3A::IDENTITY }
    }

    /// Derivative of a vertex's place in the pose of `bones` by each of its weights, `position` being its place at rest:
    /// `(P_k - M R_k) R^-1 p`, with `P_k` and `R_k` the matrices of its k-th bone in the pose and at rest, `R` the blend
    /// of the latter and `M` the vertex's motion. Zero for a vertex that stays where it is.
    pub fn by_weights(&self, bones: &[DMat4], influences: &Influences, position: Vec3) -> [Vec3; 4] {
        let rest = blend(&self.rest, influences);
        if !is_invertible(&rest) {
            return [Vec3::ZERO; 4];
        }
        let inverse = rest.inverse();
        let bound = inverse.transform_point3(position.as_dvec3()).extend(1.0);
        let motion = blend(bones, influences) * inverse;
        influences.joints.map(|joint| {
            let joint = usize::from(joint);
            (bones[joint] * bound - motion * (self.rest[joint] * bound)).truncate().as_vec3()
        })
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

#[cfg(test)]
mod tests {
    use glam::Mat4;

    use super::*;
    use crate::data::{Bone, Surface};

    /// Two bones whose rest pose is not their bind pose, under one vertex.
    fn model() -> Model {
        let bone = |node, rest_world| Bone { node, inverse_bind: Mat4::IDENTITY, rest_world };
        let turned = Mat4::from_rotation_x(0.4) * Mat4::from_translation(Vec3::Y);
        let rig = Rig {
            bones: vec![bone(0, Mat4::IDENTITY), bone(1, turned)],
            source_skin: Some(0),
            poses: vec![Pose { frame: None, world: vec![Mat4::from_rotation_y(0.3), Mat4::from_rotation_z(1.1)] }],
        };
        let surface =
            Surface { positions: vec![Vec3::ONE], influences: vec![Influences::rigid(0)], ..Surface::default() };
        Model { surface, rig: Some(rig), ..Model::empty("pair") }
    }

    #[test]
    fn derivatives_by_weights_match_central_differences() {
        let model = model();
        let skinning = LinearBlend::of(&model).expect("bones");
        let bones = skinning.bones(&skinning.poses()[0]);
        let p = Vec3::new(0.7, -0.2, 1.3);
        let at = |k: usize, step: f32| {
            let mut influences = Influences { joints: [1, 0, 0, 0], weights: [0.625, 0.375, 0.0, 0.0] };
            influences.weights[k] += step;
            skinning.motions(&bones, &[influences])[0].transform_point3(p)
        };
        let influences = Influences { joints: [1, 0, 0, 0], weights: [0.625, 0.375, 0.0, 0.0] };
        let derivatives = skinning.by_weights(&bones, &influences, p);
        for (k, derivative) in derivatives.into_iter().enumerate().take(2) {
            let h = 0.004;
            let difference = (at(k, h) - at(k, -h)) / (2.0 * h);
            assert!(derivative.distance(difference) < 1e-3, "{k}: {derivative} {difference}");
            assert!(derivative.length() > 0.1);
        }
    }
}
