use glam::{Affine2, Vec2, Vec3, Vec4};
use image::{DynamicImage, RgbImage, RgbaImage};

use crate::settings::TextureFormat;

use super::{AlphaMode, Influences, Material, Model, Surface, Texture, TextureRef, Wrap};

/// One finished level of detail.
#[derive(Clone, Debug)]
pub struct Level {
    /// Most triangles allowed.
    pub budget: u32,
    /// Distance to the source, as a fraction of the diagonal of the source's bounding box.
    pub error: f32,
    /// Its triangles.
    pub mesh: LevelMesh,
    /// Its skin lists only the joints that it hangs on, and not all of the source's.
    pub own_joints: bool,
    /// Its one material.
    pub material: LevelMaterial,
    /// Its one texture set.
    pub textures: LevelTextures,
}

/// Triangles of a level, vertices duplicated along chart borders. Rest pose, world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelMesh {
    /// World space.
    pub positions: Vec<Vec3>,
    /// Unit length.
    pub normals: Vec<Vec3>,
    /// MikkTSpace; empty if the level has no normal map.
    pub tangents: Vec<Vec4>,
    /// In [0, 1], origin at the top left.
    pub uvs: Vec<Vec2>,
    /// Bones of each vertex; empty for a static model.
    pub influences: Vec<Influences>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// One for each of the source's [`Morphs`](super::Morphs), or none.
    pub morphs: Vec<LevelMorph>,
}

/// What a morph target does to each vertex of a level at a weight of one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelMorph {
    /// How far it goes, in the world at rest, in metres.
    pub positions: Vec<Vec3>,
    /// How its normal changes.
    pub normals: Vec<Vec3>,
}

/// Factors and modes of a level's material; what varies over the surface is in [`LevelTextures`].
#[derive(Clone, Debug, PartialEq)]
pub struct LevelMaterial {
    /// How alpha is used.
    pub alpha_mode: AlphaMode,
    /// Back faces are drawn too.
    pub double_sided: bool,
    /// `KHR_materials_unlit`.
    pub unlit: bool,
    /// Used if there is no occlusion-roughness-metallic texture.
    pub metallic: f32,
    /// Used if there is no occlusion-roughness-metallic texture.
    pub roughness: f32,
    /// Multiplied onto the emissive texture; zero without one.
    pub emissive: Vec3,
}

/// Square textures of one size, clamped at the borders.
#[derive(Clone, Debug)]
pub struct LevelTextures {
    /// sRGB; alpha is coverage in the modes that use it, else 255.
    pub base_color: RgbaImage,
    /// Tangent-space normals.
    pub normal: Option<RgbImage>,
    /// Occlusion in red, roughness in green, metalness in blue.
    pub occlusion_roughness_metallic: Option<RgbImage>,
    /// sRGB.
    pub emissive: Option<RgbImage>,
    /// How colours are stored in a file.
    pub format: TextureFormat,
}

impl Level {
    /// The level as if it were a source, so that it can be drawn and measured in the same way. Rest pose, without bones.
    pub fn to_model(&self, name: &str) -> Model {
        let mesh = &self.mesh;
        let wrap = [Wrap::Clamp; 2];
        let mut textures = Vec::new();
        let mut bind = |image: Option<RgbaImage>, srgb: bool| {
            let texture = Texture::new(&image?, wrap, srgb);
            textures.push(texture);
            Some(TextureRef { texture: textures.len() - 1, uv_set: 0, transform: Affine2::IDENTITY })
        };
        let rgba = |image: &Option<RgbImage>| image.clone().map(|i| DynamicImage::ImageRgb8(i).to_rgba8());
        let rough_metal = bind(rgba(&self.textures.occlusion_roughness_metallic), false);
        let material = Material {
            base_color_texture: bind(Some(self.seen_colors()), true),
            normal_texture: bind(rgba(&self.textures.normal), false),
            emissive_texture: bind(rgba(&self.textures.emissive), true),
            metallic: if rough_metal.is_some() { 1.0 } else { self.material.metallic },
            roughness: if rough_metal.is_some() { 1.0 } else { self.material.roughness },
            metallic_roughness_texture: rough_metal,
            occlusion_texture: rough_metal,
            emissive: self.material.emissive,
            alpha_mode: self.material.alpha_mode,
            double_sided: self.material.double_sided,
            unlit: self.material.unlit,
            ..Material::default()
        };
        let emitting = Material {
            base_color: Vec4::W,
            emissive: Vec3::ONE,
            emissive_texture: material.base_color_texture,
            ..material.clone()
        };
        let surface = Surface {
            positions: mesh.positions.clone(),
            normals: mesh.normals.clone(),
            tangents: mesh.tangents.clone(),
            uvs: [mesh.uvs.clone(), Vec::new()],
            triangles: mesh.triangles.clone(),
            material: mesh.triangles.iter().map(|&t| u32::from(self.triangle_only_emits(t))).collect(),
            ..Surface::default()
        };
        Model { surface, materials: vec![material, emitting], textures, ..Model::empty(name) }
    }

    /// Base colours, and emitted ones where those are black: see [`Material::only_emits`].
    fn seen_colors(&self) -> RgbaImage {
        let mut colors = self.textures.base_color.clone();
        for (x, y, color) in colors.enumerate_pixels_mut().filter(|&(x, y, _)| self.only_emits(x, y)) {
            let light = self.textures.emissive.as_ref().map_or([0; 3], |image| image.get_pixel(x, y).0);
            color.0[..3].copy_from_slice(&light);
        }
        colors
    }

    /// Whether nothing but emitted light is seen of a texel.
    fn only_emits(&self, x: u32, y: u32) -> bool {
        let emissive = self.textures.emissive.as_ref().filter(|_| self.material.emissive == Vec3::ONE);
        let black = self.textures.base_color.get_pixel(x, y).0[..3] == [0; 3];
        black && emissive.is_some_and(|image| image.get_pixel(x, y).0 != [0; 3])
    }

    /// The same of a triangle, by its middle.
    fn triangle_only_emits(&self, triangle: [u32; 3]) -> bool {
        let [width, height] = [self.textures.base_color.width(), self.textures.base_color.height()];
        let [a, b, c] = triangle.map(|v| self.mesh.uvs[v as usize]);
        let texel = |c: f32, size: u32| ((c * size as f32) as u32).min(size.saturating_sub(1));
        let middle = (a + b + c) / 3.0;
        width > 0 && height > 0 && self.only_emits(texel(middle.x, width), texel(middle.y, height))
    }
}
