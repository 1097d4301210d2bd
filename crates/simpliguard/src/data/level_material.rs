//! The material and the textures of a level.

use glam::{Vec3, Vec4};
use image::{RgbImage, RgbaImage};
use serde::{Deserialize, Serialize};

use super::{AlphaMode, Transmission};

/// Factors and modes of a level's material. Values that vary over the surface are in [`LevelTextures`].
#[derive(Clone, Debug, PartialEq)]
pub struct LevelMaterial {
    /// Use of alpha.
    pub alpha_mode: AlphaMode,
    /// Back faces are drawn too.
    pub double_sided: bool,
    /// `KHR_materials_unlit`.
    pub unlit: bool,
    /// Linear colour and alpha, multiplied onto the texture of base colours; the whole colour without one.
    pub base_color: Vec4,
    /// 0 to 1. Used if there is no occlusion-roughness-metallic texture.
    pub metallic: f32,
    /// 0 to 1. Used if there is no occlusion-roughness-metallic texture.
    pub roughness: f32,
    /// Linear light, multiplied onto the emissive texture; zero without one.
    pub emissive: Vec3,
    /// Light passes through it.
    pub transmission: Option<Transmission>,
}

/// The material of a layer of a level.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerMaterial {
    /// A material of its own, whose textures are those of the level.
    Baked(LevelMaterial),
    /// A material of the source with the source's textures: its index in [`Model::materials`](super::Model::materials).
    Source(u32),
}

impl LayerMaterial {
    /// The material, if it is the level's own.
    pub fn baked(&self) -> Option<&LevelMaterial> {
        match self {
            Self::Baked(material) => Some(material),
            Self::Source(_) => None,
        }
    }
}

/// Square textures of one size, clamped at the borders.
#[derive(Clone, Debug)]
pub struct LevelTextures {
    /// sRGB; alpha is coverage in the modes that use it, else 255. `None` if the whole level has one colour.
    pub base_color: Option<RgbaImage>,
    /// Tangent-space normals.
    pub normal: Option<RgbImage>,
    /// Occlusion in red, roughness in green, metalness in blue.
    pub occlusion_roughness_metallic: Option<RgbImage>,
    /// sRGB.
    pub emissive: Option<RgbImage>,
    /// Storage of the colours in a file.
    pub format: TextureFormat,
}

/// Storage of colours in the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum TextureFormat {
    /// Lossless.
    #[default]
    Png,
    /// Lossy, for images without alpha. Quality from 1, the smallest file, to 100, the best image.
    Jpeg(u32),
}

impl LevelTextures {
    /// True if there is no texture.
    pub fn is_empty(&self) -> bool {
        let Self { base_color, normal, occlusion_roughness_metallic, emissive, .. } = self;
        base_color.is_none() && normal.is_none() && occlusion_roughness_metallic.is_none() && emissive.is_none()
    }

    /// Checks that all textures are square, of one size and not empty.
    ///
    /// # Errors
    /// The texture and its size.
    pub fn validate(&self) -> Result<(), String> {
        let dimensions = |image: &Option<RgbImage>| image.as_ref().map(RgbImage::dimensions);
        let maps = [
            ("base colour", self.base_color.as_ref().map(RgbaImage::dimensions)),
            ("normal map", dimensions(&self.normal)),
            ("occlusion-roughness-metallic map", dimensions(&self.occlusion_roughness_metallic)),
            ("emissive map", dimensions(&self.emissive)),
        ];
        let mut found = maps.into_iter().filter_map(|(name, size)| Some((name, size?)));
        let Some((first, (width, height))) = found.next() else { return Ok(()) };
        if width != height || width == 0 {
            return Err(format!("the {first} has {width} x {height} texels; textures are square"));
        }
        match found.find(|(_, size)| *size != (width, height)) {
            Some((name, (w, h))) => {
                Err(format!("the {name} has {w} x {h} texels beside a {first} of {width} x {height}"))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_are_square_and_of_one_size() {
        let set = |base: [u32; 2], map: [u32; 2]| LevelTextures {
            base_color: Some(RgbaImage::new(base[0], base[1])),
            normal: None,
            occlusion_roughness_metallic: None,
            emissive: Some(RgbImage::new(map[0], map[1])),
            format: TextureFormat::Png,
        };
        assert_eq!(set([4, 4], [4, 4]).validate(), Ok(()));
        assert!(set([4, 2], [4, 2]).validate().expect_err("broken").contains("4 x 2"));
        assert!(set([0, 0], [0, 0]).validate().expect_err("broken").contains("0 x 0"));
        assert!(set([4, 4], [2, 2]).validate().expect_err("broken").contains("emissive map has 2 x 2"));
    }
}
