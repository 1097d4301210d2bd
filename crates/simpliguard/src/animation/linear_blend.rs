//! Linear blend skinning: the motion of vertices with their bones, from the rest pose into another pose.

use glam::{Affine3A, DMat4, Vec3};
use rayon::prelude::*;

use super::bind_space::{bind_spaces, is_invertible, to_bind_space};
use crate::data::{Influences, Model, Pose, Rig};

/// Linear blend skinning with a rig, as the written levels have it.
pub struct LinearBlend<'a> {
    rig: &'a Rig,
    /// The transform of each bone from its bind space to its joint.
    bind: Vec<DMat4>,
    /// The transform of each bone from its bind space to the world in the rest pose.
    rest: Vec<DMat4>,
}

/// Vertices in the rest pose of a blend.
pub struct BoundVertices<'v> {
    influences: &'v [Influences],
    /// Of each vertex, the inverse of its blended rest matrix; `None` if it has none.
    inverse_rest: Vec<Option<DMat4>>,
}

impl<'a> LinearBlend<'a> {
    /// The blend of a model; `None` if the model has no bones.
    pub fn of(model: &'a Model) -> Option<Self> {
        let rig = model.rig.as_ref()?;
        let spaces = bind_spaces(rig, &model.surface.influences);
        let bind: Vec<DMat4> = (0..rig.bones.len())
            .map(|bone| {
                let inverse_bind = rig.bones[bone].inverse_bind.as_dmat4();
                // A single skin is written as it is; the bones of several skins are rebased onto the world.
                if rig.source_skin.is_some() { inverse_bind } else { inverse_bind * to_bind_space(rig, spaces[bone]) }
            })
            .collect();
        let rest = rig.bones.iter().zip(&bind).map(|(bone, bind)| bone.rest_world.as_dmat4() * *bind).collect();
        Some(Self { rig, bind, rest })
    }

    /// The frames of the source's clips.
    pub fn poses(&self) -> &'a [Pose] {
        &self.rig.poses
    }

    /// The transform of each bone from its bind space to the world in `pose`.
    pub fn bones(&self, pose: &Pose) -> Vec<DMat4> {
        pose.world.iter().zip(&self.bind).map(|(world, bind)| world.as_dmat4() * *bind).collect()
    }

    /// Vertices with these influences, to be moved into poses.
    pub fn bind<'v>(&self, influences: &'v [Influences]) -> BoundVertices<'v> {
        let inverse_rest =
            influences.par_iter().with_min_len(256).map(|influences| self.inverse_rest(influences)).collect();
        BoundVertices { influences, inverse_rest }
    }

    /// The motion of each vertex from the rest pose into the pose of `bones`. A vertex whose blended rest matrix has no
    /// inverse does not move.
    pub fn motions(&self, bones: &[DMat4], vertices: &BoundVertices<'_>) -> Vec<Affine3A> {
        let vertices = vertices.influences.par_iter().zip(&vertices.inverse_rest).with_min_len(256);
        let motion = |(influences, inverse_rest): (&Influences, &Option<DMat4>)| {
            let motion = inverse_rest.map(|inverse_rest| (blended(bones, influences) * inverse_rest).as_mat4());
            motion.filter(|motion| motion.is_finite()).map_or(Affine3A::IDENTITY, Affine3A::from_mat4)
        };
        vertices.map(motion).collect()
    }

    /// The inverse of a vertex's blended rest matrix; `None` if it has none.
    fn inverse_rest(&self, influences: &Influences) -> Option<DMat4> {
        let rest = blended(&self.rest, influences);
        is_invertible(&rest).then(|| rest.inverse())
    }

    /// The derivative of a vertex's position in the pose of `bones` with respect to each of its weights.
    ///
    /// It is `(P_k - M R_k) R^-1 p`, with `p` the `position` in the rest pose, `P_k` and `R_k` the matrices of the k-th
    /// bone in the pose and at rest, `R` the blend of all `R_k` and `M` the motion of the vertex. It is zero for a
    /// vertex whose `R` has no inverse.
    pub fn by_weights(&self, bones: &[DMat4], influences: &Influences, position: Vec3) -> [Vec3; 4] {
        let Some(inverse) = self.inverse_rest(influences) else { return [Vec3::ZERO; 4] };
        let bound = inverse.transform_point3(position.as_dvec3()).extend(1.0);
        let motion = blended(bones, influences) * inverse;
        influences.joints.map(|joint| {
            let joint = usize::from(joint);
            (bones[joint] * bound - motion * (self.rest[joint] * bound)).truncate().as_vec3()
        })
    }
}

/// The sum of the bones' matrices, weighted by a vertex's influences.
fn blended(matrices: &[DMat4], influences: &Influences) -> DMat4 {
    let slots = influences.joints.iter().zip(influences.weights).filter(|(_, weight)| *weight > 0.0);
    slots.fold(DMat4::ZERO, |sum, (&joint, weight)| sum + matrices[usize::from(joint)] * f64::from(weight))
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
        let blend = LinearBlend::of(&model).expect("bones");
        let bones = blend.bones(&blend.poses()[0]);
        let p = Vec3::new(0.7, -0.2, 1.3);
        let at = |k: usize, step: f32| {
            let mut influences = Influences { joints: [1, 0, 0, 0], weights: [0.625, 0.375, 0.0, 0.0] };
            influences.weights[k] += step;
            blend.motions(&bones, &blend.bind(&[influences]))[0].transform_point3(p)
        };
        let influences = Influences { joints: [1, 0, 0, 0], weights: [0.625, 0.375, 0.0, 0.0] };
        let derivatives = blend.by_weights(&bones, &influences, p);
        for (k, derivative) in derivatives.into_iter().enumerate().take(2) {
            let h = 0.004;
            let difference = (at(k, h) - at(k, -h)) / (2.0 * h);
            assert!(derivative.distance(difference) < 1e-3, "{k}: {derivative} {difference}");
            assert!(derivative.length() > 0.1);
        }
    }
}
