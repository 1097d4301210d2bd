//! Skeletons, clips, poses, and how vertices follow them.

mod closest;
mod linear_blend;
mod motions;
mod poses;
pub(crate) mod skeleton;
mod weights;

pub(crate) use closest::{closest_influences, corner_weights, influences_at, weights_at};
pub use linear_blend::LinearBlend;
pub(crate) use linear_blend::{bind_spaces, is_invertible, to_bind_space};
pub use motions::Motions;
pub use poses::Poses;
pub use skeleton::Skeleton;
pub(crate) use weights::{Weights, blended, ordered, project};
