//! The encoder of blocks.

use ctt_bc7f::bindings::cPackBC7FlagDefaultPartiallyAnalytical;
use glam::{UVec2, uvec2};
use rayon::prelude::*;

use crate::block_texture::{BLOCK_BYTES, BLOCK_SIDE, BlockTexture, blocks_of};
use crate::mipmaps::{MipChain, mipmap_count, mipmap_size};

/// Half as fast as the next lower quality, for 0.3 dB more.
const FLAGS: u32 = cPackBC7FlagDefaultPartiallyAnalytical;
/// Deflate level of the blocks: within 3 % of the size of level 6, in less time.
const DEFLATE_LEVEL: u8 = 3;
/// Bytes of the texels of a block.
const TEXELS_OF_BLOCK: usize = 64;

/// The deflated blocks of an image and its mipmaps, the same for any number of threads. `None` if the size does not
/// [fit](BlockTexture::fits).
pub fn compress(chain: &MipChain) -> Option<Vec<u8>> {
    if !BlockTexture::fits(chain.size) {
        return None;
    }
    let (mut blocks, mut rest) = (Vec::new(), &chain.texels[..]);
    for number in 0..mipmap_count(chain.size) {
        let size = mipmap_size(chain.size, number);
        let (mipmap, smaller) = rest.split_at(4 * size.element_product() as usize);
        encode(mipmap, size, &mut blocks);
        rest = smaller;
    }
    Some(miniz_oxide::deflate::compress_to_vec(&blocks, DEFLATE_LEVEL))
}

/// Appends the blocks of a mipmap, row by row.
fn encode(texels: &[u8], size: UVec2, blocks: &mut Vec<u8>) {
    let UVec2 { x: columns, y: rows } = blocks_of(size);
    let start = blocks.len();
    blocks.resize(start + BLOCK_BYTES * (columns * rows) as usize, 0);
    let of_rows = blocks[start..].par_chunks_mut(BLOCK_BYTES * columns as usize);
    of_rows.enumerate().for_each(|(row, out)| {
        let of_row = (0..columns).flat_map(|column| texels_of_block(texels, size, uvec2(column, row as u32)));
        let of_row: Vec<u8> = of_row.collect();
        ctt_bc7f::compress_blocks_into(&of_row, out, FLAGS);
    });
}

/// The texels of a block. Beyond the image, the last row and column repeat.
fn texels_of_block(texels: &[u8], size: UVec2, block: UVec2) -> [u8; TEXELS_OF_BLOCK] {
    let mut out = [0; TEXELS_OF_BLOCK];
    for (i, texel) in out.chunks_exact_mut(4).enumerate() {
        let within = uvec2(i as u32 % BLOCK_SIDE, i as u32 / BLOCK_SIDE);
        let place = (BLOCK_SIDE * block + within).min(size - 1);
        let at = 4 * (place.y as usize * size.x as usize + place.x as usize);
        texel.copy_from_slice(&texels[at..at + 4]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::Content;
    use crate::mipmaps::mip_chain;

    fn chain(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> MipChain {
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let texels = places.flat_map(|(x, y)| texel(x, y)).collect();
        mip_chain(texels, uvec2(width, height), Content::Data).expect("four bytes a texel")
    }

    fn round_trip(chain: &MipChain) -> Vec<u8> {
        let UVec2 { x: width, y: height } = chain.size;
        let texture = BlockTexture { buffer_view: 0, width, height, srgb: false };
        let blocks = texture.inflate(&compress(chain).expect("it fits")).expect("the blocks of this texture");
        texture.decode(&blocks, texture.mipmap_count())
    }

    /// A smooth image with a little noise.
    fn picture(x: u32, y: u32) -> [u8; 4] {
        let noise = (x * 7 + y * 13) % 5;
        [x * 3 + noise, y * 4 + noise, 90 + x + y, 255].map(|byte| byte.min(255) as u8)
    }

    #[test]
    fn one_colour_stays_what_it_is() {
        for colour in [[0, 0, 0, 0], [255; 4], [128, 128, 255, 255]] {
            let image = chain(8, 8, |_, _| colour);
            assert_eq!(round_trip(&image), image.texels);
        }
    }

    #[test]
    fn mipmaps_that_are_no_multiple_of_a_block_keep_their_texels() {
        // 12 x 20, 6 x 10, 3 x 5, 1 x 2 and 1 x 1 texels.
        let image = chain(12, 20, picture);
        let decoded = round_trip(&image);
        assert_eq!(decoded.len(), image.texels.len());
        let largest = image.texels.iter().zip(&decoded).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(largest <= Some(12), "{largest:?}");
    }

    #[test]
    fn noise_of_a_compressed_picture_is_small() {
        let image = chain(64, 64, picture);
        let decoded = round_trip(&image);
        let squares = image.texels.iter().zip(&decoded).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
        let mse = squares.sum::<f64>() / image.texels.len() as f64;
        assert!(10.0 * (255.0 * 255.0 / mse).log10() > 42.0, "{mse}");
    }

    #[test]
    fn blocks_are_the_same_for_any_number_of_threads() {
        let image = chain(64, 36, picture);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| compress(&image))
        };
        assert_eq!(with(1), with(7));
        assert!(with(2).is_some_and(|bytes| !bytes.is_empty()));
    }

    #[test]
    fn a_size_that_is_no_multiple_of_a_block_is_refused() {
        assert_eq!(compress(&chain(6, 8, picture)), None);
    }
}
