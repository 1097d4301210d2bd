//! Plain data that stages pass on: the source model, meshes, images, atlases and finished levels. No algorithms.
//!
//! The `validate` methods check what the comments on the fields promise. Topology is checked in
//! [`geometry`](crate::geometry).

mod atlas;
mod candidate;
mod cards;
mod deviation;
mod document;
mod glob;
pub(crate) mod image;
mod level;
mod level_material;
mod level_mesh;
mod material;
mod material_weight;
mod mesh;
mod model;
mod morphs;
mod node_pattern;
mod parts;
mod rig;
mod surface;
mod texture;

pub use atlas::Atlas;
pub use candidate::{Candidate, Reconstruction};
pub use cards::{Cards, NO_CARD};
pub use deviation::Deviation;
pub use document::Document;
pub use glob::compile_glob;
pub use level::{Level, LevelLayer};
pub use level_material::{LayerMaterial, LevelMaterial, LevelTextures, TextureFormat};
pub use level_mesh::{LevelMesh, LevelMorph};
pub use material::{AlphaMode, Material, TextureRef, Transmission};
pub use material_weight::MaterialWeight;
pub use mesh::{TriMesh, area_vector, bounds};
pub use model::Model;
pub use morphs::{MorphTarget, Morphs};
pub use node_pattern::NodePattern;
pub use parts::{NO_PART, Parts};
pub use rig::{Bone, Influences, Pose, Rig};
pub use simpliguard_texture::{linear_to_srgb, srgb_to_linear, to_byte};
pub(crate) use surface::gather;
pub use surface::{SMALLEST_EXTENT, Surface};
pub use texture::{Texture, Wrap};
