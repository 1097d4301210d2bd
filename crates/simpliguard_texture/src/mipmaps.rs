//! Mipmaps. The mean of 2 x 2 texels becomes one texel of the next mipmap: colours in linear light and weighted by alpha,
//! normals as vectors.

use glam::{UVec2, Vec4};

use crate::content::Content;

/// An image of four bytes a texel, with all its mipmaps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MipChain {
    /// Width and height of the image.
    pub size: UVec2,
    /// The texels of the image, then those of each mipmap, the largest first.
    pub texels: Vec<u8>,
}

/// The number of mipmaps of an image, with the image itself.
pub fn mipmap_count(size: UVec2) -> u32 {
    size.max_element().max(1).ilog2() + 1
}

/// The size of a mipmap; number 0 is the image itself.
pub fn mipmap_size(size: UVec2, number: u32) -> UVec2 {
    (size >> number).max(UVec2::ONE)
}

/// The image with all its mipmaps. `None` if it does not have four bytes a texel.
pub fn mip_chain(mut texels: Vec<u8>, size: UVec2, content: Content) -> Option<MipChain> {
    let count = size.x as usize * size.y as usize;
    if count == 0 || count.checked_mul(4) != Some(texels.len()) {
        return None;
    }
    let (image, _) = texels.as_chunks::<4>();
    let cut_out = match content {
        Content::CutOut(least) => {
            let kept = image.iter().filter(|texel| f32::from(texel[3]) >= 255.0 * least).count();
            Some((least, kept as f32 / image.len() as f32))
        }
        _ => None,
    };
    let mut mipmap: Vec<Vec4> = match mipmap_count(size) {
        1 => Vec::new(),
        _ => half_resolution(size, |i| content.read(image[i])),
    };
    for number in 1..mipmap_count(size) {
        let alpha = cut_out.map_or(1.0, |(least, fraction)| alpha_that_keeps(fraction, least, &mipmap));
        texels.extend(mipmap.iter().flat_map(|&texel| content.write(texel, alpha)));
        mipmap = half_resolution(mipmap_size(size, number), |i| mipmap[i]);
    }
    Some(MipChain { size, texels })
}

/// Means of 2 x 2 texels, or of two texels where an image is one texel wide or high.
fn half_resolution(size: UVec2, texel: impl Fn(usize) -> Vec4) -> Vec<Vec4> {
    let half = mipmap_size(size, 1);
    let at = |x: u32, y: u32| texel((y.min(size.y - 1) * size.x + x.min(size.x - 1)) as usize);
    let mean = |x: u32, y: u32| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
    (0..half.y).flat_map(|y| (0..half.x).map(move |x| (x, y))).map(|(x, y)| mean(2 * x, 2 * y)).collect()
}

/// Factor on the alpha of a mipmap with which this fraction of its texels reaches `least`. At least one, because a
/// larger cut-out is not seen.
fn alpha_that_keeps(fraction: f32, least: f32, texels: &[Vec4]) -> f32 {
    let mut alphas: Vec<f32> = texels.iter().map(|texel| texel.w).collect();
    let count = (fraction * alphas.len() as f32).round() as usize;
    if count == 0 {
        return 1.0;
    }
    let (_, &mut last, _) = alphas.select_nth_unstable_by(count - 1, |a, b| b.total_cmp(a));
    // Up to the next byte, so that rounding does not remove it again.
    (((255.0 * least).floor() + 1.0) / 255.0 / last).max(1.0)
}

#[cfg(test)]
mod tests {
    use glam::uvec2;

    use super::*;

    /// The mipmaps of a square of these texels, the largest first.
    fn mipmaps(content: Content, side: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<Vec<[u8; 4]>> {
        let places = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
        let texels = places.flat_map(|(x, y)| texel(x, y)).collect();
        let chain = mip_chain(texels, UVec2::splat(side), content).expect("four bytes a texel");
        let mut left = chain.texels.as_chunks::<4>().0;
        let mut all = Vec::new();
        for number in 0..mipmap_count(chain.size) {
            let (mipmap, rest) = left.split_at(mipmap_size(chain.size, number).element_product() as usize);
            all.push(mipmap.to_vec());
            left = rest;
        }
        assert!(left.is_empty());
        all
    }

    fn checkers(x: u32, y: u32, [a, b]: [[u8; 4]; 2]) -> [u8; 4] {
        if (x + y).is_multiple_of(2) { a } else { b }
    }

    #[test]
    fn mipmaps_end_with_one_texel() {
        assert_eq!([uvec2(1, 1), uvec2(4, 4), uvec2(5, 12), uvec2(1, 8)].map(mipmap_count), [1, 3, 4, 4]);
        assert_eq!(
            [0, 1, 2, 3].map(|n| mipmap_size(uvec2(5, 12), n)),
            [(5, 12), (2, 6), (1, 3), (1, 1)].map(UVec2::from)
        );
        let chain = mip_chain(vec![9; 5 * 12 * 4], uvec2(5, 12), Content::Data).expect("four bytes a texel");
        assert_eq!(chain.texels, vec![9; 4 * (5 * 12 + 2 * 6 + 3 + 1)]);
        assert_eq!(mip_chain(vec![9; 4], uvec2(1, 1), Content::Colour).expect("a texel").texels, [9; 4]);
        assert_eq!([uvec2(1, 1), uvec2(0, 7)].map(|size| mip_chain(vec![9; 5], size, Content::Data)), [None, None]);
    }

    #[test]
    fn every_colour_stays_what_it_is() {
        for byte in 0..=255 {
            let colour = [byte, 255 - byte, 7, 255];
            for mipmap in mipmaps(Content::Colour, 4, |_, _| colour) {
                assert!(mipmap.iter().all(|texel| *texel == colour), "{mipmap:?}");
            }
        }
    }

    #[test]
    fn colours_are_averaged_in_linear_light_and_data_is_not() {
        let black_and_white = |x, y| checkers(x, y, [[0, 0, 0, 255], [255; 4]]);
        // Half of the light is this in sRGB.
        assert_eq!(mipmaps(Content::Colour, 4, black_and_white)[1], [[188, 188, 188, 255]; 4]);
        assert_eq!(mipmaps(Content::Data, 4, black_and_white)[2], [[128, 128, 128, 255]]);
    }

    #[test]
    fn what_is_transparent_lends_no_colour() {
        let red_on_nothing = |x, y| checkers(x, y, [[200, 0, 0, 255], [0, 255, 0, 0]]);
        let [r, g, b, a] = mipmaps(Content::Colour, 2, red_on_nothing)[1][0];
        assert!(r > 195 && g < 20 && (b, a) == (0, 128), "{:?}", [r, g, b, a]);
    }

    #[test]
    fn normals_keep_their_length() {
        // Two that lean to either side, 45 degrees each.
        let leaning = |x, y| checkers(x, y, [[218, 128, 218, 255], [38, 128, 218, 255]]);
        let [x, y, z, _] = mipmaps(Content::Normals, 2, leaning)[1][0];
        assert!(x.abs_diff(128) <= 1 && y.abs_diff(128) <= 1 && z >= 254, "{:?}", [x, y, z]);
    }

    #[test]
    fn as_much_of_a_cut_out_stays() {
        // Blades of grass: a quarter of each row.
        let blades = |x: u32, _: u32| [90, 160, 40, if x.is_multiple_of(4) { 255 } else { 0 }];
        let all = mipmaps(Content::CutOut(0.5), 64, blades);
        for mipmap in &all[..5] {
            let kept = mipmap.iter().filter(|texel| texel[3] >= 128).count() as f32 / mipmap.len() as f32;
            assert!(kept >= 0.25, "{kept} of {} texels", mipmap.len());
        }
        // As colours that blend they would disappear.
        assert!(mipmaps(Content::Colour, 64, blades)[2].iter().all(|texel| texel[3] == 64));
    }
}
