//! Skeleton too small for a level, folded into those that they hang on.

use crate::animation::{Skeleton, Weights};
use crate::data::{Influences, Model, TriMesh};

/// The bones of a model that stand in for others in a level.
pub struct BoneRemap(Vec<u16>);

impl BoneRemap {
    /// For a level of `faces` triangles: a joint that with all that hangs on it moves less than `least` of them, by the
    /// source's area, gives way to the nearest joint above that moves as many, or to the topmost. `None` if none does.
    pub fn of(model: &Model, faces: usize, least: f32) -> Option<Self> {
        let joints = Skeleton::of(model).filter(|_| least > 0.0)?;
        let shares = shares(model, &joints);
        let bones = model.rig.as_ref().map_or(0, |rig| rig.bones.len());
        let bone_of = |joint: usize| (0..bones).position(|bone| joints.of_bone(bone as u16) == joint);
        let stand_in = |bone: usize| {
            let own = joints.of_bone(bone as u16);
            let is_large = |&joint: &usize| shares[joint] * faces as f64 >= f64::from(least);
            let topmost = || joints.lineage(own).last();
            let joint = joints.lineage(own).find(is_large).or_else(topmost).filter(|joint| *joint != own);
            joint.and_then(bone_of).unwrap_or(bone) as u16
        };
        let all: Vec<u16> = (0..bones).map(stand_in).collect();
        all.iter().enumerate().any(|(bone, &other)| bone != usize::from(other)).then_some(Self(all))
    }

    /// Influences on the bones that are left.
    pub fn fold(&self, influences: &mut [Influences]) {
        for influences in influences {
            let mut weights = Weights::default();
            for (&bone, &weight) in influences.joints.iter().zip(&influences.weights).filter(|(_, w)| **w > 0.0) {
                weights.add_joint(self.0[usize::from(bone)], weight);
            }
            *influences = weights.strongest();
        }
    }
}

/// The part of the source's area that each joint moves with all that hangs on it.
fn shares(model: &Model, joints: &Skeleton<'_>) -> Vec<f64> {
    let surface = &model.surface;
    let mesh = TriMesh { positions: surface.positions.clone(), triangles: surface.triangles.clone() };
    let mut shares = vec![0.0; joints.count()];
    let mut total = 0.0;
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let third = f64::from(mesh.area_vector(t).length()) / 3.0;
        for influences in triangle.iter().map(|&v| &surface.influences[v as usize]) {
            total += third;
            for (&bone, &weight) in influences.joints.iter().zip(&influences.weights).filter(|(_, w)| **w > 0.0) {
                joints.lineage(joints.of_bone(bone)).for_each(|joint| shares[joint] += third * f64::from(weight));
            }
        }
    }
    shares.iter_mut().for_each(|share| *share /= total.max(f64::MIN_POSITIVE));
    shares
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::animation::arm;

    /// The arm with a triangle of area `areas[i]` on each of its joints.
    fn model(areas: [f32; 3]) -> Model {
        let mut model = arm();
        for (joint, area) in areas.into_iter().enumerate() {
            let first = model.surface.positions.len() as u32;
            model.surface.positions.extend([Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * area]);
            model.surface.influences.extend([Influences::rigid(joint as u16); 3]);
            model.surface.triangles.push([first, first + 1, first + 2]);
        }
        model
    }

    #[test]
    fn small_joints_give_way_to_the_nearest_above_that_is_large_enough() {
        // Parts of the area with what hangs on them: 1, 0.3 and 0.05.
        let model = model([14.0, 5.0, 1.0]);
        let of = |least: f32| BoneRemap::of(&model, 100, least).map(|s| s.0);
        assert_eq!(of(0.0), None);
        assert_eq!(of(4.0), None);
        assert_eq!(of(6.0), Some(vec![0, 1, 1]));
        assert_eq!(of(31.0), Some(vec![0, 0, 0]));
        // The topmost stays, however small.
        assert_eq!(of(101.0), Some(vec![0, 0, 0]));
    }

    #[test]
    fn folded_influences_add_up() {
        let mut influences = [Influences { joints: [2, 0, 1, 0], weights: [0.5, 0.25, 0.25, 0.0] }];
        BoneRemap(vec![0, 1, 1]).fold(&mut influences);
        assert_eq!(influences, [Influences { joints: [1, 0, 0, 0], weights: [0.75, 0.25, 0.0, 0.0] }]);
    }
}
