//! Textures in blocks of BC7: 4 x 4 texels in 16 bytes.
//!
//! In a file, a texture in blocks is a buffer view of its own, deflated. The image that a texture refers to is a small
//! PNG, so that every loader can load the file. Its `extras` describe the blocks.

use glam::{UVec2, uvec2};
use serde::{Deserialize, Serialize};

use crate::mipmaps::{mipmap_count, mipmap_size};

/// Side of a block in texels.
pub(crate) const BLOCK_SIDE: u32 = 4;
/// Bytes of a block.
pub(crate) const BLOCK_BYTES: usize = 16;
/// The longest side in texels: no graphics card takes more.
const LONGEST_SIDE: u32 = 16_384;

/// `extras` of an image whose texels lie in blocks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ImageExtras {
    /// The part that this program writes.
    pub simpliguard: Stamp,
}

/// The part of an image's `extras` that this program writes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// The blocks.
    pub bc7: BlockTexture,
}

/// A texture in blocks of BC7, with all its mipmaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BlockTexture {
    /// Index of the buffer view with the deflated blocks.
    #[serde(rename = "bufferView")]
    pub buffer_view: usize,
    /// Width in texels, a multiple of four.
    pub width: u32,
    /// Height in texels, a multiple of four.
    pub height: u32,
    /// True for colours, which are sRGB encoded.
    pub srgb: bool,
}

impl BlockTexture {
    /// Tells whether textures of this size can be stored in blocks. A GPU takes whole blocks alone.
    pub fn fits(size: UVec2) -> bool {
        size.min_element() >= BLOCK_SIDE && size.max_element() <= LONGEST_SIDE && size % BLOCK_SIDE == UVec2::ZERO
    }

    /// Width and height in texels.
    pub fn size(&self) -> UVec2 {
        uvec2(self.width, self.height)
    }

    /// Number of bytes of the first `mipmaps` mipmaps, the image among them.
    pub fn byte_len(&self, mipmaps: u32) -> usize {
        let blocks = |number| blocks_of(mipmap_size(self.size(), number)).element_product() as usize;
        (0..mipmaps).map(|number| BLOCK_BYTES * blocks(number)).sum()
    }

    /// Number of mipmaps, with the image itself.
    pub fn mipmap_count(&self) -> u32 {
        mipmap_count(self.size())
    }

    /// Bytes on the GPU.
    pub fn gpu_bytes(&self) -> u64 {
        self.byte_len(self.mipmap_count()) as u64
    }

    /// The blocks of the image and all its mipmaps. `None` if the bytes are no blocks of this texture.
    pub fn inflate(&self, deflated: &[u8]) -> Option<Vec<u8>> {
        if !Self::fits(self.size()) {
            return None;
        }
        let length = self.byte_len(self.mipmap_count());
        let blocks = miniz_oxide::inflate::decompress_to_vec_with_limit(deflated, length).ok()?;
        (blocks.len() == length).then_some(blocks)
    }

    /// The texels of the first `mipmaps` mipmaps, the image among them, of blocks that [`Self::inflate`] has returned. Four
    /// bytes a texel.
    pub fn decode(&self, blocks: &[u8], mipmaps: u32) -> Vec<u8> {
        let (mut texels, mut rest) = (Vec::new(), blocks);
        for number in 0..mipmaps {
            let size = mipmap_size(self.size(), number);
            let bytes = BLOCK_BYTES * blocks_of(size).element_product() as usize;
            let (own, smaller) = rest.split_at(bytes.min(rest.len()));
            decode_mipmap(own, size, &mut texels);
            rest = smaller;
        }
        texels
    }
}

/// Number of blocks along both sides of a mipmap.
pub(crate) fn blocks_of(size: UVec2) -> UVec2 {
    uvec2(size.x.div_ceil(BLOCK_SIDE), size.y.div_ceil(BLOCK_SIDE))
}

/// Appends the texels of a mipmap, without what its last blocks have beyond it.
fn decode_mipmap(blocks: &[u8], size: UVec2, texels: &mut Vec<u8>) {
    let (side, across) = (BLOCK_SIDE as usize, blocks_of(size).x as usize);
    let pitch = 4 * side * across;
    let mut rows = vec![0; side * pitch];
    for (row, of_row) in blocks.chunks_exact(BLOCK_BYTES * across).enumerate() {
        for (column, block) in of_row.chunks_exact(BLOCK_BYTES).enumerate() {
            bcdec_rs::bc7(block, &mut rows[4 * side * column..], pitch);
        }
        let height = side.min(size.y as usize - side * row);
        rows.chunks_exact(pitch).take(height).for_each(|line| texels.extend(&line[..4 * size.x as usize]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(width: u32, height: u32) -> BlockTexture {
        BlockTexture { buffer_view: 3, width, height, srgb: true }
    }

    #[test]
    fn sizes_are_those_of_whole_blocks() {
        assert_eq!(texture(4, 4).gpu_bytes(), 3 * 16);
        assert_eq!(texture(8, 4).gpu_bytes(), (2 + 1 + 1 + 1) * 16);
        // 12 x 20, 6 x 10, 3 x 5, 1 x 2 and 1 x 1 texels.
        assert_eq!(texture(12, 20).gpu_bytes(), (15 + 6 + 2 + 1 + 1) * 16);
        assert_eq!(texture(12, 20).byte_len(2), 21 * 16);
        // Three quarters less than four bytes a texel.
        assert_eq!(texture(1024, 1024).gpu_bytes(), 1_398_128);
    }

    #[test]
    fn only_whole_blocks_fit() {
        let fits = [(4, 4), (1024, 12), (16_384, 4), (6, 4), (4, 2), (0, 0), (32_768, 4)];
        let expected = [true, true, true, false, false, false, false];
        assert_eq!(fits.map(|(x, y)| BlockTexture::fits(uvec2(x, y))), expected);
    }

    #[test]
    fn extras_of_an_image_name_the_view() {
        let extras = ImageExtras { simpliguard: Stamp { bc7: texture(8, 4) } };
        let json = serde_json::json!({ "simpliguard": { "bc7": {
            "bufferView": 3, "width": 8, "height": 4, "srgb": true,
        } } });
        assert_eq!(serde_json::to_value(&extras).expect("plain values"), json);
        assert_eq!(serde_json::from_value::<ImageExtras>(json).expect("as written"), extras);
    }

    #[test]
    fn bytes_that_are_no_blocks_of_the_texture_are_refused() {
        let deflated = |bytes: usize| miniz_oxide::deflate::compress_to_vec(&vec![0; bytes], 3);
        assert_eq!(texture(4, 4).inflate(&deflated(48)), Some(vec![0; 48]));
        for (texture, deflated) in [
            (texture(4, 4), deflated(47)),
            (texture(4, 4), deflated(49)),
            (texture(4, 4), vec![7; 9]),
            (texture(5, 4), deflated(48)),
            (texture(u32::MAX, 4), deflated(48)),
            (texture(0, 0), Vec::new()),
        ] {
            assert_eq!(texture.inflate(&deflated), None, "{texture:?}");
        }
    }

    #[test]
    fn damaged_blocks_decode_to_some_texels() {
        let texture = texture(12, 20);
        let length = texture.byte_len(texture.mipmap_count());
        let mut state = 1u32;
        let noise = (0..length).map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        });
        let noise: Vec<u8> = noise.collect();
        assert_eq!(texture.decode(&noise, 5).len(), 4 * (240 + 60 + 15 + 2 + 1));
        assert_eq!(texture.decode(&noise, 1).len(), 4 * 240);
    }
}
