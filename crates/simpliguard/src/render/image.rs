//! Images with coverage.

use glam::{Vec3, Vec4, Vec4Swizzles};
use image::{Rgba, RgbaImage};

use crate::data::image::halved;

/// A square image: sRGB encoded, colours premultiplied by coverage, rows from the bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Side in pixels.
    pub size: usize,
    /// Encoded, premultiplied RGBA.
    pub pixels: Vec<[u8; 4]>,
}

impl Image {
    /// A pixel, each channel as a fraction of full scale.
    #[inline]
    pub fn at(&self, i: usize) -> Vec4 {
        let [r, g, b, a] = self.pixels[i].map(f32::from);
        Vec4::new(r, g, b, a) * (1.0 / 255.0)
    }

    /// The image at half the size, each pixel the mean of four; `None` if the size is odd.
    pub fn halved(&self) -> Option<Self> {
        let size = self.size.is_multiple_of(2).then_some(self.size / 2)?;
        let mean = |four: [[u8; 4]; 4]| {
            std::array::from_fn(|channel| ((four.iter().map(|p| u16::from(p[channel])).sum::<u16>() + 2) / 4) as u8)
        };
        Some(Self { size, pixels: halved(&self.pixels, [self.size; 2], mean) })
    }

    /// The image over a background of one encoded grey, 0 to 1, rows from the top.
    pub fn over(&self, background: f32) -> RgbaImage {
        RgbaImage::from_fn(self.size as u32, self.size as u32, |x, y| {
            let p = self.at((self.size - 1 - y as usize) * self.size + x as usize);
            let c = p.xyz() + Vec3::splat(background * (1.0 - p.w));
            let [r, g, b] = c.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            Rgba([r, g, b, 255])
        })
    }
}

/// A difference of premultiplied colours, once both lie over a background of one encoded grey, 0 to 1.
#[inline]
pub(crate) fn difference_over(difference: Vec4, background: f32) -> Vec3 {
    difference.xyz() - background * difference.w
}

/// PSNR in dB of a mean squared error of colours from 0 to 1; 100 for pictures that are alike.
pub fn decibels(mean_squared_error: f64) -> f64 {
    -10.0 * libm::log10(mean_squared_error.max(1e-10))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_of_half_the_size_has_means_of_four() {
        let pixels = (0..16).map(|i| [10 * i, 255, 0, i]).collect();
        let half = Image { size: 4, pixels }.halved().expect("even");
        assert_eq!(half.pixels, [[25, 255, 0, 3], [45, 255, 0, 5], [105, 255, 0, 11], [125, 255, 0, 13]]);
        assert_eq!(Image { size: 1, pixels: vec![[0; 4]] }.halved(), None);
    }
}
