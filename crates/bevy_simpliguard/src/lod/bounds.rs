//! The bounding box of a model in the space of its levels, from its most detailed level.
//!
//! It is taken from the level and not from the source, because the level's vertices are known in that space: those of a
//! static level are stored in it, and those of a skinned level are skinned in the rest pose. The boxes of
//! the source are known per node only, and the union of rotated boxes is too large. With `source: Drop` there are none.

use bevy::math::{Mat4, Vec3};
use gltf::Node;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub(super) min: Vec3,
    pub(super) max: Vec3,
}

impl Bounds {
    fn of(points: impl IntoIterator<Item = Vec3>) -> Option<Self> {
        points.into_iter().map(|p| Self { min: p, max: p }).reduce(Self::union)
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    pub(super) fn center(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Half the diagonal.
    pub(super) fn radius(&self) -> f32 {
        0.5 * self.min.distance(self.max)
    }
}

/// The box of a primitive in its own space.
pub(super) fn own(primitive: &gltf::Primitive<'_>) -> Bounds {
    let bounds = primitive.bounding_box();
    Bounds { min: bounds.min.into(), max: bounds.max.into() }
}

/// The box of a skinned primitive of `node` in the rest pose, in the space that `into_space` leads to from the scene.
/// `rest` has the transforms of the nodes. `None` if data for skinning is missing.
pub(super) fn skinned(
    rest: &[Mat4],
    into_space: Mat4,
    node: &Node<'_>,
    primitive: &gltf::Primitive<'_>,
    buffers: &[Vec<u8>],
) -> Option<Bounds> {
    let bytes = |buffer: gltf::Buffer<'_>| buffers.get(buffer.index()).map(Vec::as_slice);
    let skin = node.skin()?;
    let mut joints: Vec<Mat4> = skin.joints().map(|joint| into_space * rest[joint.index()]).collect();
    if let Some(inverse_binds) = skin.reader(bytes).read_inverse_bind_matrices() {
        joints.iter_mut().zip(inverse_binds).for_each(|(joint, inverse)| *joint *= Mat4::from_cols_array_2d(&inverse));
    }
    let reader = primitive.reader(bytes);
    let influences = reader.read_joints(0)?.into_u16().zip(reader.read_weights(0)?.into_f32());
    let points = reader.read_positions()?.zip(influences).map(|(position, (indices, weights))| {
        let matrix = |index: u16| joints.get(usize::from(index)).copied().unwrap_or(Mat4::IDENTITY);
        let position = Vec3::from(position);
        indices.iter().zip(weights).map(|(&index, weight)| weight * matrix(index).transform_point3(position)).sum()
    });
    Bounds::of(points)
}
