//! Textures in blocks: for files that a game loads, in place of PNG and JPEG.
//!
//! Blocks stay compressed on the GPU, where they take a quarter of the memory of texels, and they come with their mipmaps.
//! They are no part of glTF 2.0: loaders fail, or lose a whole model, if an image is of a kind that they do not read. So an
//! image in blocks is a small PNG, and its `extras` name the blocks
//! ([`ImageExtras`](simpliguard_texture::ImageExtras)). The plugin hands the blocks to the GPU, or decodes them where a GPU
//! takes none. Loaders that know nothing of them show the small image.

mod contents;
mod write;

#[cfg(test)]
mod tests;

pub use write::{BLOCKS_VERSION, compress_textures};
