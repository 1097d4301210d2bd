//! Images at half resolution: one way to choose the four pixels, for every pixel type.
//!
//! The mean of the four is the caller's: textures average in linear light, views round encoded bytes.

use glam::Vec4;

/// Width and height at half resolution: rounded down, at least one.
pub(crate) fn half_size(size: [usize; 2]) -> [usize; 2] {
    size.map(|side| (side / 2).max(1))
}

/// An image of `size` pixels, width first, at [`half_size`]: each pixel is the `mean` of 2 x 2, given row by row. An
/// odd side leaves out its last row or column; a side of one counts its only pixel twice.
pub(crate) fn halved<T: Copy, U>(pixels: &[T], size: [usize; 2], mean: impl Fn([T; 4]) -> U) -> Vec<U> {
    let [width, height] = size;
    let [half_width, half_height] = half_size(size);
    let mut out = Vec::with_capacity(half_width * half_height);
    for y in 0..half_height {
        for x in 0..half_width {
            let at = |dx: usize, dy: usize| pixels[(2 * y + dy).min(height - 1) * width + (2 * x + dx).min(width - 1)];
            out.push(mean([at(0, 0), at(1, 0), at(0, 1), at(1, 1)]));
        }
    }
    out
}

/// The mean of four colours.
pub(crate) fn mean(four: [Vec4; 4]) -> Vec4 {
    four.into_iter().sum::<Vec4>() * 0.25
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_come_row_by_row() {
        let image: Vec<u32> = (0..8).collect();
        assert_eq!(halved(&image, [4, 2], |four| four), [[0, 1, 4, 5], [2, 3, 6, 7]]);
    }

    #[test]
    fn odd_sides_lose_their_last_pixel_and_single_ones_repeat() {
        let image: Vec<u32> = (0..3).collect();
        assert_eq!(halved(&image, [3, 1], |four| four), [[0, 1, 0, 1]]);
        assert_eq!(halved(&image, [1, 3], |four| four), [[0, 0, 1, 1]]);
        assert_eq!(halved(&[9], [1, 1], |four| four), [[9; 4]]);
    }

    #[test]
    fn the_mean_of_four_colours_is_exact_for_small_numbers() {
        let colors = [1.0, 2.0, 4.0, 9.0].map(Vec4::splat);
        assert_eq!(mean(colors), Vec4::splat(4.0));
    }
}
