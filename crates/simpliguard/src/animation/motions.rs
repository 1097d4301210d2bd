//! The motion of the vertices of a mesh.

use glam::{Affine3A, Mat4, Vec3, Vec4};

/// The motion of each vertex of a mesh from the rest pose into each further pose. Empty for a mesh that does not move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motions(Vec<Vec<Affine3A>>);

impl Motions {
    /// The motions by pose, then by vertex.
    pub fn new(poses: Vec<Vec<Affine3A>>) -> Self {
        Self(poses)
    }

    /// The motion of each vertex into a pose; `None` for the rest pose and for a pose that there is not.
    pub fn of(&self, pose: Option<usize>) -> Option<&[Affine3A]> {
        self.0.get(pose?).map(Vec::as_slice)
    }

    /// Replaces the motions into a pose.
    pub fn set(&mut self, pose: usize, motions: Vec<Affine3A>) {
        self.0[pose] = motions;
    }

    /// The same motions for positions in another space; `to_world` is the transform from that space to the world.
    pub fn rebased(mut self, to_world: Affine3A) -> Self {
        let from_world = to_world.inverse();
        self.0.iter_mut().flatten().for_each(|motion| *motion = from_world * *motion * to_world);
        self
    }

    /// Replaces `clip` by the clip space positions in `pose` of vertices with these `positions` in the rest pose.
    pub fn project(&self, positions: &[Vec3], view_projection: &Mat4, pose: Option<usize>, clip: &mut Vec<Vec4>) {
        let matrix = *view_projection;
        clip.clear();
        match self.of(pose) {
            None => clip.extend(positions.iter().map(|p| matrix * p.extend(1.0))),
            Some(motions) => {
                let moved = positions.iter().zip(motions).map(|(p, motion)| motion.transform_point3(*p));
                clip.extend(moved.map(|p| matrix * p.extend(1.0)));
            }
        }
    }
}
