//! Skeletons, clips, poses, and the motion of vertices in them.

mod bind_space;
mod closest;
mod linear_blend;
mod motions;
mod pose_distances;
mod poses;
mod skeleton;
mod weights;

pub(crate) use bind_space::{bind_spaces, is_invertible, to_bind_space};
pub(crate) use closest::{corner_weights, influences_at, weights_at};
pub use linear_blend::{BoundVertices, LinearBlend};
pub use motions::Motions;
pub use poses::Poses;
pub use skeleton::Skeleton;
#[cfg(test)]
pub(crate) use skeleton::tests::arm;
pub(crate) use weights::{Weights, blended, ordered, project};
