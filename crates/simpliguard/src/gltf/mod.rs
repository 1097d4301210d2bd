//! Reading and writing of glTF.

mod authored;
mod blocks;
mod export;
mod glb;
mod gpu_cost;
mod import;
mod objects;
mod on_demand;
mod png;
mod rewrite;
mod triangles;
mod uris;

pub use authored::has_levels;
pub use blocks::{BLOCKS_VERSION, compress_textures};
pub(crate) use export::export_in;
pub use export::{ExportParams, export, export_level};
pub use glb::binary;
pub use gpu_cost::{
    GpuCost, encoded_image, gpu_cost, gpu_cost_besides, image_of_texture, texture_memory, textures_of_material,
};
pub(crate) use import::import_in;
pub use import::{ImportLimits, import};
pub(crate) use objects::{ObjectScene, SCENE_HINT, describe_scene};
pub use on_demand::{Divided, DividedPart, divide};
pub use uris::{check_binary, external_uris};
