//! The material of a source.

use glam::{Affine2, Vec3, Vec4};

/// glTF metallic-roughness material; factors are in linear light.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// As in the source; empty if unnamed.
    pub name: String,
    /// Linear RGBA, multiplied onto texture and vertex colour.
    pub base_color: Vec4,
    /// sRGB RGBA.
    pub base_color_texture: Option<TextureRef>,
    /// 0 to 1.
    pub metallic: f32,
    /// 0 to 1.
    pub roughness: f32,
    /// Roughness in green, metalness in blue.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normals.
    pub normal_texture: Option<TextureRef>,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Occlusion in red.
    pub occlusion_texture: Option<TextureRef>,
    /// 0 to 1.
    pub occlusion_strength: f32,
    /// Linear, multiplied by `KHR_materials_emissive_strength`.
    pub emissive: Vec3,
    /// sRGB.
    pub emissive_texture: Option<TextureRef>,
    /// Use of alpha.
    pub alpha_mode: AlphaMode,
    /// Back faces are drawn too.
    pub double_sided: bool,
    /// `KHR_materials_unlit`.
    pub unlit: bool,
    /// Light passes through it; `None` if none does.
    pub transmission: Option<Transmission>,
    /// Index in the glTF's `materials`; `None` for the default material.
    pub index: Option<usize>,
    /// The `TEXCOORD_n` that are the two sets of [`crate::data::Surface::uvs`].
    pub uv_sets: [usize; 2],
}

/// Factors of `KHR_materials_transmission`, `KHR_materials_ior` and `KHR_materials_volume`. Their textures are not read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transmission {
    /// Fraction of the light that passes through the surface; above 0, at most 1.
    pub factor: f32,
    /// Index of refraction, at least 1; 1.5 for glass.
    pub ior: f32,
    /// Thickness of the volume beneath the surface, in units of its mesh; 0 for a thin wall.
    pub thickness: f32,
    /// Distance within the volume after which light has the attenuation colour, in the same units; infinite if it keeps its own.
    pub attenuation_distance: f32,
    /// Linear RGB.
    pub attenuation_color: Vec3,
}

/// Base colours up to this reflect no visible light.
const BLACK: f32 = 1e-3;

impl Material {
    /// True if it reflects nothing and emits up to white. Many tools write light that was baked into a texture in this
    /// way. Emission brighter than white is a light source and does not count.
    pub fn only_emits(&self) -> bool {
        let dark = self.base_color.truncate().max_element() <= BLACK;
        dark && !self.unlit && self.emissive.max_element() > BLACK && self.emissive.max_element() <= 1.0
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            occlusion_texture: None,
            occlusion_strength: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            transmission: None,
            index: None,
            uv_sets: [0, 1],
        }
    }
}

/// glTF alpha modes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Discarded below the cutoff.
    Mask {
        /// Alpha threshold.
        cutoff: f32,
    },
    /// Drawn over the surfaces behind.
    Blend,
}

/// A texture slot of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into [`crate::data::Model::textures`].
    pub texture: usize,
    /// Index into [`crate::data::Surface::uvs`].
    pub uv_set: usize,
    /// `KHR_texture_transform`, applied to the vertices' coordinates.
    pub transform: Affine2,
}
