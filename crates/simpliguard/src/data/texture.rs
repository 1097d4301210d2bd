//! Decoded images with mip chains, filtered in linear light.

use glam::{Vec2, Vec4};
use image::RgbaImage;

/// Wrap mode of one texture axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// Repeats.
    Repeat,
    /// Repeats, every second time mirrored.
    Mirror,
    /// The border texel goes on.
    Clamp,
}

/// An image with its mip chain and its sampler's wrap modes.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Falling in size by halves, rounded down, to 1x1.
    mips: Vec<Mip>,
    wrap: [Wrap; 2],
    /// Value of each byte of red, green and blue.
    decode: &'static [f32; 256],
}

#[derive(Clone, Debug)]
struct Mip {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// Builds the mip chain. With `srgb`, red, green and blue are averaged and returned in linear light.
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
        Self { mips, wrap, decode }
    }

    /// Width and height in texels.
    pub fn size(&self) -> [u32; 2] {
        [self.mips[0].width, self.mips[0].height]
    }

    /// Trilinear sample at `uv` (origin top left), `lod` in mip levels. RGB linear if the texture is sRGB.
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
        let at = |x: u32, y: u32| self.decoded(mip.texels[(y * mip.width + x) as usize]);
        let top = at(x.0, y.0).lerp(at(x.1, y.0), x.2);
        let bottom = at(x.0, y.1).lerp(at(x.1, y.1), x.2);
        top.lerp(bottom, y.2)
    }

    fn decoded(&self, texel: [u8; 4]) -> Vec4 {
        let [r, g, b, a] = texel.map(usize::from);
        Vec4::new(self.decode[r], self.decode[g], self.decode[b], a as f32 / 255.0)
    }
}

impl Mip {
    fn halved(&self, decode: &[f32; 256], srgb: bool) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut texels = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                let mut sum = Vec4::ZERO;
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, y) = ((2 * x + dx).min(self.width - 1), (2 * y + dy).min(self.height - 1));
                    let [r, g, b, a] = self.texels[(y * self.width + x) as usize].map(usize::from);
                    sum += Vec4::new(decode[r], decode[g], decode[b], a as f32 / 255.0);
                }
                let mean = sum * 0.25;
                let encode = |c: f32| if srgb { linear_to_srgb(c) } else { c };
                let bytes = [encode(mean.x), encode(mean.y), encode(mean.z), mean.w];
                texels.push(bytes.map(|c| (c * 255.0 + 0.5) as u8));
            }
        }
        Self { width, height, texels }
    }
}

/// The two texels beside a coordinate and the weight of the second.
fn wrapped_pair(u: f32, size: u32, wrap: Wrap) -> (u32, u32, f32) {
    let u = if u.is_finite() { u } else { 0.0 };
    // One period first, so that large coordinates keep their fraction.
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

/// sRGB to linear light, both 0 to 1.
pub fn srgb_to_linear(c: f32) -> f32 {
    if c <= 0.04045 { c / 12.92 } else { libm::powf((c + 0.055) / 1.055, 2.4) }
}

/// Linear light to sRGB, both 0 to 1.
pub fn linear_to_srgb(c: f32) -> f32 {
    let c = c.clamp(0.0, 1.0);
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * libm::powf(c, 1.0 / 2.4) - 0.055 }
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

    #[test]
    fn transfer_functions_are_inverse() {
        for i in 0..=255u8 {
            let c = f32::from(i) / 255.0;
            assert!((linear_to_srgb(srgb_to_linear(c)) - c).abs() < 1e-5);
        }
    }
}
