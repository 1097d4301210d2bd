//! The content of textures: how their texels are averaged.

use std::array::from_fn;
use std::sync::LazyLock;

use glam::{Vec3, Vec4};

use crate::srgb::{linear_to_srgb, srgb_to_linear};

/// Smallest weight of a colour. Transparent texels count a little, because the sampler mixes them in at edges.
const LEAST_ALPHA: f32 = 1.0 / 255.0;
/// Number of steps of the table from linear light to bytes. They are smaller than the steps of a byte, even in the
/// dark.
const LIGHT_STEPS: usize = 4095;

static LIGHT_OF_BYTE: LazyLock<[f32; 256]> = LazyLock::new(|| from_fn(|byte| srgb_to_linear(byte as f32 / 255.0)));
static BYTE_OF_LIGHT: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let light = (0..=LIGHT_STEPS).map(|step| step as f32 / LIGHT_STEPS as f32);
    light.map(|light| to_byte(linear_to_srgb(light))).collect()
});

/// The content of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    /// Colours, sRGB encoded.
    Colour,
    /// Colours, cut out where alpha is below this value. Mipmaps keep the fraction of texels above it.
    CutOut(f32),
    /// Unit vectors.
    Normals,
    /// Linear numbers.
    Data,
}

impl Content {
    /// True for colours.
    pub fn is_colour(self) -> bool {
        matches!(self, Self::Colour | Self::CutOut(_))
    }

    /// The value of a texel, in a form that can be averaged.
    pub(crate) fn read(self, texel: [u8; 4]) -> Vec4 {
        let [r, g, b, a] = texel.map(|byte| f32::from(byte) / 255.0);
        match self {
            Self::Colour | Self::CutOut(_) => {
                let [r, g, b, _] = texel.map(|byte| LIGHT_OF_BYTE[usize::from(byte)]);
                (a.max(LEAST_ALPHA) * Vec3::new(r, g, b)).extend(a.max(LEAST_ALPHA))
            }
            Self::Normals => (2.0 * Vec3::new(r, g, b) - 1.0).extend(a),
            Self::Data => Vec4::new(r, g, b, a),
        }
    }

    /// The texel of a mean value, with its alpha times `alpha`.
    pub(crate) fn write(self, mean: Vec4, alpha: f32) -> [u8; 4] {
        let (rgb, a) = (mean.truncate(), mean.w);
        match self {
            Self::Colour | Self::CutOut(_) => {
                let light = (rgb / a).clamp(Vec3::ZERO, Vec3::ONE) * LIGHT_STEPS as f32;
                let [r, g, b] = light.to_array().map(|x| BYTE_OF_LIGHT[x.round() as usize]);
                [r, g, b, if a > LEAST_ALPHA { to_byte((alpha * a).min(1.0)) } else { 0 }]
            }
            Self::Normals => (0.5 * rgb.normalize_or(Vec3::Z) + 0.5).extend(a).to_array().map(to_byte),
            Self::Data => mean.to_array().map(to_byte),
        }
    }
}

fn to_byte(x: f32) -> u8 {
    (255.0 * x).round() as u8
}
