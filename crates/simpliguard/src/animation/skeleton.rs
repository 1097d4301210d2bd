//! The joints of a rig: their positions, their hierarchy and the directions of their limbs.

use std::collections::BTreeMap;

use glam::{Mat4, Quat, Vec3};

use crate::data::{Bone, Model, Pose, Rig};

/// Sine of the angle between the bones at a joint above which the limb is bent there.
const BENT: f32 = 0.1;

/// The joints of a rig: the nodes of its bones.
pub struct Skeleton<'a> {
    rig: &'a Rig,
    /// Joint of each bone.
    of_bone: Vec<usize>,
    /// The nearest ancestor of each joint that is a joint too.
    parents: Vec<Option<usize>>,
    /// Position of each joint in the world, in the rest pose.
    positions: Vec<Vec3>,
}

impl<'a> Skeleton<'a> {
    /// The skeleton of a model; `None` if the model has no bones.
    pub fn of(model: &'a Model) -> Option<Self> {
        let rig = model.rig.as_ref()?;
        let mut joint_of_node = BTreeMap::new();
        let mut positions = Vec::new();
        for bone in &rig.bones {
            joint_of_node.entry(bone.node).or_insert_with(|| {
                positions.push(bone.rest_world.w_axis.truncate());
                positions.len() - 1
            });
        }
        let above = parent_nodes(model);
        let mut parents = vec![None; positions.len()];
        for (&node, &joint) in &joint_of_node {
            // The number of steps is bounded, because nodes outside the scene may form a cycle.
            let lineage = std::iter::successors(above.get(&node), |node| above.get(node)).take(above.len());
            parents[joint] = lineage.filter_map(|node| joint_of_node.get(node)).next().copied();
        }
        let of_bone = rig.bones.iter().map(|bone| joint_of_node[&bone.node]).collect();
        Some(Self { rig, of_bone, parents, positions })
    }

    /// Number of joints.
    pub fn count(&self) -> usize {
        self.positions.len()
    }

    /// The joint of a bone.
    pub fn of_bone(&self, bone: u16) -> usize {
        self.of_bone[usize::from(bone)]
    }

    /// The nearest ancestor of a joint that is a joint too.
    pub fn parent(&self, joint: usize) -> Option<usize> {
        self.parents[joint]
    }

    /// The position of a joint in the world, in the rest pose.
    pub fn place(&self, joint: usize) -> Vec3 {
        self.positions[joint]
    }

    /// The direction of the limb through a joint: halfway between the bone that ends there and the mean of those that
    /// begin there. It has unit length; it is zero for a joint without parent and children.
    pub fn axis(&self, joint: usize) -> Vec3 {
        let position = self.positions[joint];
        let before = self.parents[joint].map_or(Vec3::ZERO, |p| (position - self.positions[p]).normalize_or_zero());
        let children = (0..self.count()).filter(|&child| self.parents[child] == Some(joint));
        let after: Vec3 = children.map(|child| (self.positions[child] - position).normalize_or_zero()).sum();
        (before + after.normalize_or_zero()).normalize_or(before)
    }

    /// `joint`, its parent, the parent's parent, and so on.
    pub fn lineage(&self, joint: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(joint), |&joint| self.parents[joint])
    }

    /// The unit axis about which a joint rotates like a hinge: perpendicular to the bones that meet there, or any
    /// direction perpendicular to a limb that is straight there. `None` for a joint without parent, or whose limb has
    /// no direction.
    pub fn hinge_axis(&self, joint: usize) -> Option<Vec3> {
        let before = (self.positions[joint] - self.positions[self.parents[joint]?]).normalize_or_zero();
        let limb = self.axis(joint);
        let normal = before.cross(limb);
        if normal.length() > BENT {
            Some(normal.normalize())
        } else {
            Some(limb.try_normalize()?.any_orthonormal_vector())
        }
    }

    /// True if `joint` is `above` or a descendant of it.
    pub fn hangs_on(&self, joint: usize, above: usize) -> bool {
        self.lineage(joint).any(|joint| joint == above)
    }

    /// The rest pose with one joint and its descendants rotated about the joint.
    pub fn turned(&self, joint: usize, rotation: Quat) -> Pose {
        let position = self.positions[joint];
        let turn = Mat4::from_translation(position) * Mat4::from_quat(rotation) * Mat4::from_translation(-position);
        let moved = |(bone, &of): (&Bone, &usize)| {
            if self.hangs_on(of, joint) { turn * bone.rest_world } else { bone.rest_world }
        };
        Pose { frame: None, world: self.rig.bones.iter().zip(&self.of_bone).map(moved).collect() }
    }
}

/// The parent of each node that has one.
fn parent_nodes(model: &Model) -> BTreeMap<usize, usize> {
    let nodes = model.document.json.get("nodes").and_then(|nodes| nodes.as_array()).map_or(&[][..], Vec::as_slice);
    let mut above = BTreeMap::new();
    for (parent, node) in nodes.iter().enumerate() {
        let children = node.get("children").and_then(|children| children.as_array());
        for child in children.into_iter().flatten().filter_map(|child| child.as_u64()) {
            above.insert(child as usize, parent);
        }
    }
    above
}

#[cfg(test)]
pub(crate) mod tests {
    use std::f32::consts::FRAC_PI_2;

    use serde_json::json;

    use super::*;

    /// Three joints in a row along x, at 0, 1 and 2; a node that is no joint lies between the last two in the
    /// hierarchy.
    pub(crate) fn arm() -> Model {
        let bone = |node: usize, x: f32| Bone {
            node,
            inverse_bind: Mat4::from_translation(-Vec3::X * x),
            rest_world: Mat4::from_translation(Vec3::X * x),
        };
        let bones = vec![bone(0, 0.0), bone(1, 1.0), bone(3, 2.0)];
        let mut model = Model::empty("arm");
        model.document.json = json!({"nodes": [{"children": [1]}, {"children": [2]}, {"children": [3]}, {}]});
        model.rig = Some(Rig { bones, source_skin: Some(0), poses: Vec::new() });
        model
    }

    #[test]
    fn joints_know_what_they_hang_on_past_other_nodes() {
        let model = arm();
        let skeleton = Skeleton::of(&model).expect("bones");
        assert_eq!([0, 1, 2].map(|joint| skeleton.parent(joint)), [None, Some(0), Some(1)]);
        assert!(skeleton.hangs_on(2, 0) && !skeleton.hangs_on(0, 2));
        assert_eq!([0, 1, 2].map(|joint| skeleton.axis(joint)), [Vec3::X; 3]);
    }

    #[test]
    fn hinges_turn_across_their_limbs() {
        let mut model = arm();
        assert!(Skeleton::of(&model).expect("bones").hinge_axis(1).expect("an axis").dot(Vec3::X).abs() < 1e-6);
        // The hand is moved sideways: the elbow turns across the arm's plane.
        let rig = model.rig.as_mut().expect("bones");
        rig.bones[2].rest_world = Mat4::from_translation(Vec3::new(1.5, 1.0, 0.0));
        let skeleton = Skeleton::of(&model).expect("bones");
        assert!(skeleton.hinge_axis(1).expect("an axis").dot(Vec3::Z) > 0.999);
        assert_eq!(skeleton.hinge_axis(0), None);
    }

    #[test]
    fn a_turn_takes_along_what_hangs_on_the_joint() {
        let model = arm();
        let pose = Skeleton::of(&model).expect("bones").turned(1, Quat::from_rotation_z(FRAC_PI_2));
        let positions: Vec<Vec3> = pose.world.iter().map(|world| world.w_axis.truncate()).collect();
        let expected = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0)];
        assert!(positions.iter().zip(expected).all(|(p, e)| p.distance(e) < 1e-6), "{positions:?}");
    }
}
