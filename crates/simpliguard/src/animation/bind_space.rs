//! The spaces that vertices are blended in.

use glam::{DMat3, DMat4};

use crate::data::{Influences, Rig};
use crate::geometry::DisjointSets;

/// Smallest determinant at which a blend of joints is inverted, relative to the cube of the matrix's longest axis.
const MIN_DETERMINANT: f64 = 1e-9;

/// The bind space of each bone, named by its first bone. Bones that share vertices of the source share a bind space.
pub(crate) fn bind_spaces(rig: &Rig, source: &[Influences]) -> Vec<u32> {
    let mut sets = DisjointSets::new(rig.bones.len());
    for influences in source {
        for (&joint, &weight) in influences.joints.iter().zip(&influences.weights).skip(1) {
            let (a, b) = (influences.joints[0] as usize, joint as usize);
            if weight > 0.0 && a.max(b) < rig.bones.len() {
                sets.join(a, b);
            }
        }
    }
    sets.roots()
}

/// The transform from the world to the bind space of a first bone; the identity if that space has no volume.
pub(crate) fn to_bind_space(rig: &Rig, first_bone: u32) -> DMat4 {
    let bone = &rig.bones[first_bone as usize];
    let space = bone.rest_world.as_dmat4() * bone.inverse_bind.as_dmat4();
    if is_invertible(&space) { space.inverse() } else { DMat4::IDENTITY }
}

/// True if a matrix is finite and keeps volume, relative to its size.
pub(crate) fn is_invertible(m: &DMat4) -> bool {
    let linear = DMat3::from_mat4(*m);
    let size = linear.x_axis.length().max(linear.y_axis.length()).max(linear.z_axis.length());
    let determinant = linear.determinant().abs();
    m.is_finite() && determinant > MIN_DETERMINANT * size.powi(3)
}
