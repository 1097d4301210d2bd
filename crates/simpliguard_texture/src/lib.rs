//! Mipmaps of textures, and their compression in blocks for the GPU.
//!
//! The pipeline writes blocks into processed files, and the plugin hands them to the GPU, so both use this crate. A game
//! also makes mipmaps of textures that are not compressed.

mod block_texture;
mod content;
#[cfg(feature = "encode")]
mod encode;
mod mipmaps;
mod srgb;

pub use block_texture::{BlockTexture, ImageExtras, Stamp};
pub use content::Content;
#[cfg(feature = "encode")]
pub use encode::compress;
pub use mipmaps::{MipChain, mip_chain, mipmap_count, mipmap_size};
pub use srgb::{linear_to_srgb, srgb_to_linear, to_byte};
