//! Textures of a level.
//!
//! Each texel of the atlas stands for a point of the level. A ray along the level's normal finds what the source shows
//! there ([`bake`]); this is the initial texture (in place of the paper's 3.3 splatting it also reaches what no view
//! sees), and after the last vertex step the source of the normal, occlusion-roughness-metallic and emissive maps.
//! Gutters around the charts are filled by dilation.

mod bake;
mod coverage;
mod maps;
#[cfg(test)]
mod tests;
mod texel_map;

pub use bake::bake;
pub use coverage::keep_coverage;
pub use maps::{Channels, Varying, level_material, level_mesh, maps};
pub use texel_map::{Texel, dilate, fill, texel_map};

/// Rings of texels filled around each chart.
pub const GUTTER_STEPS: usize = 8;
