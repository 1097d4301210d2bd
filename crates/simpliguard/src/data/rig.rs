//! The skeleton of a source model, and the bones of a vertex.

use glam::Mat4;

/// The bones of a model, over all its skins and all mesh nodes that an animation moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// At most 65,535. One bone stands for one node with one inverse bind matrix.
    pub bones: Vec<Bone>,
    /// The source's only skin, if `bones` are exactly its joints in order. The levels then reuse it unchanged.
    pub source_skin: Option<usize>,
    /// A few poses from each of the source's clips; random poses if it has no clip.
    pub poses: Vec<Pose>,
}

/// One bone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bone {
    /// Index of the joint in the glTF's `nodes`.
    pub node: usize,
    /// From bind space to the joint.
    pub inverse_bind: Mat4,
    /// From the joint to the world in the rest pose of the node tree.
    pub rest_world: Mat4,
}

/// The bones at one moment of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Index in the glTF's `animations`, and seconds in that clip; `None` for a random pose.
    pub frame: Option<(usize, f32)>,
    /// From each bone's joint to the world.
    pub world: Vec<Mat4>,
}

impl Rig {
    /// From bind space to the world in the rest pose, for a vertex with these influences: `sum w (rest_world
    /// inverse_bind)`.
    pub fn rest_matrix(&self, influences: &Influences) -> Mat4 {
        let mut m = Mat4::ZERO;
        for (&joint, &weight) in influences.joints.iter().zip(&influences.weights) {
            if weight > 0.0 {
                let bone = &self.bones[joint as usize];
                m += bone.rest_world * bone.inverse_bind * weight;
            }
        }
        m
    }
}

/// Up to four bones of one vertex. Weights descend and sum to one; unused slots are zero in both arrays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Influences {
    /// Indices into [`Rig::bones`].
    pub joints: [u16; 4],
    /// Fraction of each bone.
    pub weights: [f32; 4],
}

/// Largest distance from one of the weights' sum: far above rounding, far below a visible scale.
const SUM_TOLERANCE: f32 = 1e-3;

impl Influences {
    /// Entirely on one bone.
    pub fn rigid(joint: u16) -> Self {
        Self { joints: [joint, 0, 0, 0], weights: [1.0, 0.0, 0.0, 0.0] }
    }

    /// The bone that alone holds the vertex, if one does.
    pub fn rigid_joint(&self) -> Option<u16> {
        (self.weights[0] > 1.0 - SUM_TOLERANCE).then_some(self.joints[0])
    }

    /// Checks that the weights lie in 0 to 1, descend and sum to one within 1e-3, and that unused slots are zero.
    ///
    /// # Errors
    /// The broken rule, with the values found.
    pub fn validate(&self) -> Result<(), String> {
        let Self { joints, weights } = self;
        let sum: f32 = weights.iter().sum();
        let sums_to_one = (sum - 1.0).abs() <= SUM_TOLERANCE;
        if !sums_to_one || !weights.iter().all(|w| *w >= 0.0) {
            return Err(format!("weights {weights:?} are negative or sum to {sum} instead of 1"));
        }
        if !weights.is_sorted_by(|a, b| a >= b) {
            return Err(format!("weights {weights:?} do not descend"));
        }
        if joints.iter().zip(weights).any(|(joint, weight)| *weight == 0.0 && *joint != 0) {
            return Err(format!("joints {joints:?} name a bone in a slot without weight: {weights:?}"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sound_influences_pass() {
        assert_eq!(Influences::rigid(7).validate(), Ok(()));
        assert_eq!(Influences { joints: [3, 1, 0, 0], weights: [0.7, 0.3, 0.0, 0.0] }.validate(), Ok(()));
    }

    #[test]
    fn a_vertex_is_rigid_if_one_bone_holds_it_alone() {
        assert_eq!(Influences::rigid(7).rigid_joint(), Some(7));
        assert_eq!(Influences { joints: [3, 1, 0, 0], weights: [0.7, 0.3, 0.0, 0.0] }.rigid_joint(), None);
    }

    #[test]
    fn each_broken_rule_is_named() {
        let message = |joints, weights| Influences { joints, weights }.validate().expect_err("broken");
        assert!(message([0; 4], [0.5, 0.4, 0.0, 0.0]).contains("sum to 0.9"));
        assert!(message([0; 4], [0.0; 4]).contains("sum to 0"));
        assert!(message([0; 4], [f32::NAN, 0.0, 0.0, 0.0]).contains("sum to NaN"));
        assert!(message([0; 4], [1.5, -0.5, 0.0, 0.0]).contains("negative"));
        assert!(message([0; 4], [0.25, 0.75, 0.0, 0.0]).contains("do not descend"));
        assert!(message([0, 5, 0, 0], [1.0, 0.0, 0.0, 0.0]).contains("slot without weight"));
    }
}
