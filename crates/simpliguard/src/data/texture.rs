//! Decoded images with mip chains, filtered in linear light.

use std::sync::Arc;

use glam::{Vec2, Vec4};
use image::RgbaImage;
use simpliguard_texture::{linear_to_srgb, srgb_to_linear};

use super::image::{half_size, halved, mean};

/// Wrap mode of one texture axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wrap {
    /// Repeats.
    Repeat,
    /// Repeats, mirrored every second time.
    Mirror,
    /// The border texel continues.
    Clamp,
}

/// An image with its mip chain and its sampler's wrap modes.
#[derive(Clone, Debug)]
pub struct Texture {
    /// From full size down to 1 x 1. Each side is half the one before, rounded down. Clones share them.
    mips: Arc<[Mip]>,
    wrap: [Wrap; 2],
    /// The value of each byte in red, green and blue.
    decode: &'static [f32; 256],
}

#[derive(Clone, Debug)]
struct Mip {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// Builds the mip chain. With `srgb`, red, green and blue are averaged and sampled in linear light.
    ///
    /// # Panics
    /// If a side of the image is zero.
    pub fn new(image: &RgbaImage, wrap: [Wrap; 2], srgb: bool) -> Self {
        assert!(image.width() > 0 && image.height() > 0, "an image has at least one texel");
        let decode = if srgb { srgb_table() } else { linear_table() };
        let texels = image.pixels().map(|p| p.0).collect();
        let mut mips = vec![Mip { width: image.width(), height: image.height(), texels }];
        while let Some(last) = mips.last()
            && (last.width > 1 || last.height > 1)
        {
            let next = last.halved(decode, srgb);
            mips.push(next);
        }
        Self { mips: mips.into(), wrap, decode }
    }

    /// The same texels with other wrap modes.
    pub(crate) fn wrapped(&self, wrap: [Wrap; 2]) -> Self {
        Self { wrap, ..self.clone() }
    }

    /// The finest mip of at most so many texels a side, encoded as the image was.
    pub(crate) fn mip_of(&self, side: u32) -> RgbaImage {
        let fits = |mip: &&Mip| mip.width.max(mip.height) <= side;
        let mip = self.mips.iter().find(fits).unwrap_or(&self.mips[self.mips.len() - 1]);
        RgbaImage::from_fn(mip.width, mip.height, |x, y| image::Rgba(mip.texels[(y * mip.width + x) as usize]))
    }

    /// Width and height in texels.
    pub fn size(&self) -> [u32; 2] {
        [self.mips[0].width, self.mips[0].height]
    }

    /// Trilinear sample at `uv` (origin top left); `lod` counts mip levels from the finest. RGB is linear light if the
    /// texture is sRGB.
    pub fn sample(&self, uv: Vec2, lod: f32) -> Vec4 {
        let last = self.mips.len() - 1;
        let lod = if lod.is_finite() { lod.clamp(0.0, last as f32) } else { 0.0 };
        let (fine, blend) = (lod as usize, lod.fract());
        let value = self.bilinear(&self.mips[fine], uv);
        if blend < 1e-3 || fine == last { value } else { value.lerp(self.bilinear(&self.mips[fine + 1], uv), blend) }
    }

    fn bilinear(&self, mip: &Mip, uv: Vec2) -> Vec4 {
        let x = wrapped_pair(uv.x, mip.width, self.wrap[0]);
        let y = wrapped_pair(uv.y, mip.height, self.wrap[1]);
        let at = |x: u32, y: u32| decoded(mip.texels[(y * mip.width + x) as usize], self.decode);
        let top = at(x.0, y.0).lerp(at(x.1, y.0), x.2);
        let bottom = at(x.0, y.1).lerp(at(x.1, y.1), x.2);
        top.lerp(bottom, y.2)
    }
}

impl Mip {
    /// The next mip level.
    fn halved(&self, decode: &[f32; 256], srgb: bool) -> Self {
        let size = [self.width as usize, self.height as usize];
        let encode = |c: f32| if srgb { linear_to_srgb(c) } else { c };
        let texels = halved(&self.texels, size, |four| {
            let mean = mean(four.map(|texel| decoded(texel, decode)));
            let encoded = [encode(mean.x), encode(mean.y), encode(mean.z), mean.w];
            encoded.map(|c| (c * 255.0 + 0.5) as u8)
        });
        let [width, height] = half_size(size).map(|side| side as u32);
        Self { width, height, texels }
    }
}

/// A texel from 0 to 1, its colour by the table.
fn decoded(texel: [u8; 4], decode: &[f32; 256]) -> Vec4 {
    let [r, g, b, a] = texel.map(usize::from);
    Vec4::new(decode[r], decode[g], decode[b], a as f32 / 255.0)
}

/// The two texels beside a coordinate, and the weight of the second.
fn wrapped_pair(u: f32, size: u32, wrap: Wrap) -> (u32, u32, f32) {
    let u = if u.is_finite() { u } else { 0.0 };
    // Reduced to one period first, so that large coordinates keep their fraction.
    let period = match wrap {
        Wrap::Repeat => u - u.floor(),
        Wrap::Mirror => u - 2.0 * (u * 0.5).floor(),
        Wrap::Clamp => u.clamp(-1.0, 2.0),
    };
    let x = period * size as f32 - 0.5;
    let low = x.floor();
    let texel = |i: i64| -> u32 {
        let n = i64::from(size);
        let i = match wrap {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Mirror => {
                let i = i.rem_euclid(2 * n);
                if i < n { i } else { 2 * n - 1 - i }
            }
            Wrap::Clamp => i.clamp(0, n - 1),
        };
        i as u32
    };
    (texel(low as i64), texel(low as i64 + 1), x - low)
}

fn srgb_table() -> &'static [f32; 256] {
    static TABLE: std::sync::LazyLock<[f32; 256]> =
        std::sync::LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));
    &TABLE
}

fn linear_table() -> &'static [f32; 256] {
    static TABLE: std::sync::LazyLock<[f32; 256]> =
        std::sync::LazyLock::new(|| std::array::from_fn(|i| i as f32 / 255.0));
    &TABLE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_texels() -> RgbaImage {
        RgbaImage::from_raw(2, 1, vec![0, 0, 0, 255, 255, 255, 255, 255]).expect("2x1")
    }

    #[test]
    fn texel_centres_return_the_texel() {
        let texture = Texture::new(&two_texels(), [Wrap::Clamp; 2], true);
        assert_eq!(texture.sample(Vec2::new(0.25, 0.5), 0.0).x, 0.0);
        assert_eq!(texture.sample(Vec2::new(0.75, 0.5), 0.0).x, 1.0);
    }

    #[test]
    fn srgb_filters_in_linear_light() {
        let texture = Texture::new(&two_texels(), [Wrap::Clamp; 2], true);
        assert_eq!(texture.sample(Vec2::new(0.5, 0.5), 0.0).x, 0.5);
        let coarse = texture.sample(Vec2::new(0.5, 0.5), 1.0).x;
        assert!((coarse - 0.5).abs() < 3e-3, "{coarse}");
    }

    #[test]
    fn a_mip_is_the_finest_that_fits() {
        let texture = Texture::new(&two_texels(), [Wrap::Clamp; 2], false);
        assert_eq!(texture.mip_of(2), two_texels());
        assert_eq!(texture.mip_of(1).into_raw(), [128, 128, 128, 255]);
    }

    #[test]
    fn wrap_modes_differ_past_the_border() {
        let sample = |wrap| Texture::new(&two_texels(), [wrap; 2], false).sample(Vec2::new(1.25, 0.5), 0.0).x;
        assert_eq!([sample(Wrap::Repeat), sample(Wrap::Mirror), sample(Wrap::Clamp)], [0.0, 1.0, 1.0]);
    }

    #[test]
    fn poison_coordinates_give_a_colour() {
        let texture = Texture::new(&two_texels(), [Wrap::Mirror; 2], true);
        for bad in [f32::NAN, f32::INFINITY, -1e30, 1e30] {
            assert!(texture.sample(Vec2::splat(bad), bad).is_finite());
        }
    }
}
