//! Plain data that stages pass on: the source model, meshes, images, atlases and finished levels. No algorithms.

mod atlas;
mod candidate;
mod cards;
mod deviation;
mod level;
mod material;
mod material_weight;
mod mesh;
mod model;
mod texture;

pub use atlas::Atlas;
pub use candidate::{Candidate, Reconstruction};
pub use cards::{Cards, NO_CARD};
pub use deviation::Deviation;
pub use level::{Level, LevelMaterial, LevelMesh, LevelMorph, LevelTextures};
pub use material::{AlphaMode, Material, TextureRef};
pub use material_weight::MaterialWeight;
pub use mesh::{TriMesh, area_vector, bounds};
pub use model::{Bone, Document, Influences, Model, MorphTarget, Morphs, Pose, Rig, SMALLEST_EXTENT, Surface};
pub use texture::{Texture, Wrap, linear_to_srgb, srgb_to_linear};
