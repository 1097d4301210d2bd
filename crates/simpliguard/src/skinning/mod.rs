//! Skin influences of a level, transferred from the source.
//!
//! There are two methods. [`Transfer::ClosestSurface`], the default, follows "Robust Skin Weights Transfer via Weight
//! Inpainting" (Abdrashitov, Raichstat, Monsen and Hill, SIGGRAPH Asia 2023): a vertex takes the influences of the
//! closest point of the source if that point is near and faces the same way. All other vertices are filled in smoothly
//! over the edges of the level. Where the paper minimises a mix of Dirichlet and Laplacian energy, this solves
//! Laplace's equation with positive edge weights: weights stay between those around them and sum to one.
//! [`Transfer::NearestVertices`] is the formula of SimpliGuard, section 3.5, normalised.
//!
//! Both work in the rest pose and keep the four largest influences. Connected components of the source are
//! distinguished where they touch ([`SkinSource`]). Folds of one component that touch in the rest pose and face the
//! same way are not.
//!
//! A few frames of the source's clips stand for all of them ([`Poses`](crate::animation::Poses)). They count with the
//! rest pose in every later decision: visibility, the edges that collapse, the candidate that wins, vertices and
//! texels.

mod bone_remap;
mod closest_surface;
mod fit;
mod inpaint;
mod joint_planes;
mod joint_split;
mod morphs;
mod nearest_vertices;
mod skin;
mod skin_source;
mod transfer;

pub use bone_remap::BoneRemap;
pub use joint_planes::{JointPlane, joint_planes};
pub use joint_split::{SplitMesh, split_along};
pub use morphs::{surface_morphs, transfer_morphs};
pub use skin::{SkinningParams, skin};
pub use skin_source::SkinSource;
pub use transfer::{Transfer, TransferReport, transfer};
