//! Textures of a level.
//!
//! Each texel of the atlas stands for a point of the level. A ray along the level's normal finds the source's surface
//! there ([`Baker`]). These samples make the initial texture. Unlike the copies of the paper's section 3.3
//! ([`Projection`], to compare with), they also reach what no view sees. After the last vertex step the level is baked once more, for the normal,
//! occlusion-roughness-metallic and emissive maps ([`pbr_maps`]). Dilation fills the gutters around the charts
//! ([`crate::render::fill_unknown`]).

mod bake;
mod corner_normals;
mod coverage;
mod encode;
mod inverted;
mod level_mesh;
mod material;
mod pbr_maps;
mod probe;
mod projection;
mod tangents;
#[cfg(test)]
mod tests;
mod texel_map;

pub use bake::{BakeTarget, Baker};
pub use corner_normals::corner_normals;
pub use inverted::{inverted_faces, turn_inverted};
pub use level_mesh::level_mesh;
pub use material::{MaterialStatistics, level_material};
pub use pbr_maps::{Channels, pbr_maps};
pub use projection::Projection;
pub use tangents::tangents;
pub use texel_map::{Texel, TexelMap};
