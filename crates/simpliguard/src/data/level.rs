//! A finished level of detail.

use std::ops::Range;

use glam::{Affine2, Vec3, Vec4};
use image::{DynamicImage, RgbImage, RgbaImage};

use super::{
    LayerMaterial, LevelMaterial, LevelMesh, LevelTextures, Material, Model, Surface, Texture, TextureRef, Wrap,
};

/// One finished level of detail.
#[derive(Clone, Debug)]
pub struct Level {
    /// Most triangles allowed.
    pub budget: u32,
    /// Distance to the source, as a fraction of the diagonal of the source's bounding box.
    pub error: f32,
    /// Its triangles.
    pub mesh: LevelMesh,
    /// Its skin lists only the joints that it uses, instead of all joints of the source.
    pub own_joints: bool,
    /// Its surfaces: the solid one first, clear ones behind it. At least one.
    pub layers: Vec<LevelLayer>,
    /// The one texture set of the layers that do not keep materials of the source; empty if there are none.
    pub textures: LevelTextures,
}

/// A part of a level with a material of its own. The triangles of the layers follow each other in the level's mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelLayer {
    /// Number of triangles.
    pub triangles: usize,
    /// Its material.
    pub material: LayerMaterial,
}

impl Level {
    /// True if it has layers with materials of the source.
    pub fn keeps_materials(&self) -> bool {
        self.layers.iter().any(|layer| layer.material.baked().is_none())
    }

    /// The level of a source as a source model, so that it can be drawn and measured in the same way. Rest pose, without
    /// bones.
    pub fn to_model(&self, source: &Model) -> Model {
        let (mut materials, mut textures) = match self.keeps_materials() {
            true => (source.materials.clone(), source.textures.clone()),
            false => (Vec::new(), Vec::new()),
        };
        let emitting = |material: &Material| Material {
            base_color: Vec4::W,
            emissive: Vec3::ONE,
            emissive_texture: material.base_color_texture,
            ..material.clone()
        };
        let mut triangle_materials = Vec::with_capacity(self.mesh.triangles.len());
        let bound = self.bind_textures(&mut textures);
        for (range, material) in self.layer_ranges() {
            match material {
                LayerMaterial::Source(material) => triangle_materials.extend(range.map(|_| *material)),
                LayerMaterial::Baked(material) => {
                    // Followed by that of the triangles that only emit light.
                    let own = textured(material, &bound);
                    let index = materials.len() as u32;
                    let index = |t: &[u32; 3]| index + u32::from(self.triangle_only_emits(*t));
                    triangle_materials.extend(self.mesh.triangles[range].iter().map(index));
                    materials.extend([own.clone(), emitting(&own)]);
                }
            }
        }
        let surface = Surface { material: triangle_materials, ..self.surface() };
        Model { surface, materials, textures, ..Model::empty(&source.name) }
    }

    /// The triangles without materials.
    fn surface(&self) -> Surface {
        let mesh = &self.mesh;
        Surface {
            positions: mesh.positions.clone(),
            normals: mesh.normals.clone(),
            tangents: mesh.tangents.clone(),
            uvs: [mesh.uvs.clone(), mesh.second_uvs.clone()],
            colors: mesh.colors.clone(),
            triangles: mesh.triangles.clone(),
            ..Surface::default()
        }
    }

    /// The triangles of each layer, in the mesh.
    pub fn layer_ranges(&self) -> impl Iterator<Item = (Range<usize>, &LayerMaterial)> {
        self.layers.iter().scan(0, |first, layer| {
            let range = *first..*first + layer.triangles;
            *first = range.end;
            Some((range, &layer.material))
        })
    }

    /// Checks the textures, the mesh, its layers, and that the mesh is within the budget.
    ///
    /// # Errors
    /// The first broken rule, with the values found.
    pub fn validate(&self) -> Result<(), String> {
        let (faces, budget) = (self.mesh.triangles.len(), self.budget);
        if faces > budget as usize {
            return Err(format!("the level has {faces} triangles, over its budget of {budget}"));
        }
        let in_layers: usize = self.layers.iter().map(|layer| layer.triangles).sum();
        if in_layers != faces || self.layers.is_empty() {
            let layers = self.layers.len();
            return Err(format!("the level has {faces} triangles, and {in_layers} in its {layers} layers"));
        }
        if !self.textures.is_empty() && self.baked_materials().next().is_none() {
            return Err("the level has textures of its own, and all of its layers keep the source's materials".into());
        }
        let is_baked = |(_, material): &(_, &LayerMaterial)| material.baked().is_some();
        for (range, _) in self.layer_ranges().filter(is_baked) {
            self.mesh.validate_atlas(&self.mesh.triangles[range])?;
        }
        self.textures.validate()?;
        self.mesh.validate()
    }

    /// Appends the textures of the layers that are baked. Returns a material that shows them.
    fn bind_textures(&self, textures: &mut Vec<Texture>) -> Material {
        let wrap = [Wrap::Clamp; 2];
        let mut bind = |image: Option<RgbaImage>, srgb: bool| {
            let texture = Texture::new(&image?, wrap, srgb);
            textures.push(texture);
            Some(TextureRef { texture: textures.len() - 1, uv_set: 0, transform: Affine2::IDENTITY })
        };
        let rgba = |image: &Option<RgbImage>| image.clone().map(|i| DynamicImage::ImageRgb8(i).to_rgba8());
        let rough_metal = bind(rgba(&self.textures.occlusion_roughness_metallic), false);
        Material {
            base_color_texture: bind(self.seen_colors(), true),
            normal_texture: bind(rgba(&self.textures.normal), false),
            emissive_texture: bind(rgba(&self.textures.emissive), true),
            metallic_roughness_texture: rough_metal,
            occlusion_texture: rough_metal,
            ..Material::default()
        }
    }

    fn baked_materials(&self) -> impl Iterator<Item = &LevelMaterial> {
        self.layers.iter().filter_map(|layer| layer.material.baked())
    }

    /// Base colours, with emitted colours where the base colour is black: see [`Material::only_emits`].
    fn seen_colors(&self) -> Option<RgbaImage> {
        let mut colors = self.textures.base_color.clone()?;
        for (x, y, color) in colors.enumerate_pixels_mut().filter(|&(x, y, _)| self.only_emits(x, y)) {
            let light = self.textures.emissive.as_ref().map_or([0; 3], |image| image.get_pixel(x, y).0);
            color.0[..3].copy_from_slice(&light);
        }
        Some(colors)
    }

    /// True if a texel shows nothing but emitted light.
    fn only_emits(&self, x: u32, y: u32) -> bool {
        let is_whole = self.baked_materials().all(|material| material.emissive == Vec3::ONE);
        let emissive = self.textures.emissive.as_ref().filter(|_| is_whole);
        let black = self.textures.base_color.as_ref().is_some_and(|image| image.get_pixel(x, y).0[..3] == [0; 3]);
        black && emissive.is_some_and(|image| image.get_pixel(x, y).0 != [0; 3])
    }

    /// As [`Self::only_emits`], for the texel at the middle of a triangle.
    fn triangle_only_emits(&self, triangle: [u32; 3]) -> bool {
        let (width, height) = self.textures.base_color.as_ref().map_or((0, 0), RgbaImage::dimensions);
        let [a, b, c] = triangle.map(|v| self.mesh.uvs[v as usize]);
        let texel = |c: f32, size: u32| ((c * size as f32) as u32).min(size.saturating_sub(1));
        let middle = (a + b + c) / 3.0;
        width > 0 && height > 0 && self.only_emits(texel(middle.x, width), texel(middle.y, height))
    }
}

/// A layer's material with the textures that `bound` shows.
fn textured(material: &LevelMaterial, bound: &Material) -> Material {
    let has_rough_metal = bound.metallic_roughness_texture.is_some();
    Material {
        base_color: material.base_color,
        metallic: if has_rough_metal { 1.0 } else { material.metallic },
        roughness: if has_rough_metal { 1.0 } else { material.roughness },
        emissive: material.emissive,
        alpha_mode: material.alpha_mode,
        double_sided: material.double_sided,
        unlit: material.unlit,
        transmission: material.transmission,
        ..bound.clone()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use image::Rgba;

    use super::*;
    use crate::data::{AlphaMode, TextureFormat};

    fn level() -> Level {
        Level {
            budget: 1,
            error: 0.0,
            mesh: LevelMesh {
                positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
                normals: vec![Vec3::Z; 3],
                uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
                triangles: vec![[0, 1, 2]],
                ..LevelMesh::default()
            },
            own_joints: false,
            layers: vec![LevelLayer {
                triangles: 1,
                material: LayerMaterial::Baked(LevelMaterial {
                    alpha_mode: AlphaMode::Opaque,
                    double_sided: false,
                    unlit: false,
                    metallic: 0.0,
                    roughness: 1.0,
                    emissive: Vec3::ZERO,
                    base_color: Vec4::ONE,
                    transmission: None,
                }),
            }],
            textures: LevelTextures {
                base_color: Some(RgbaImage::from_pixel(4, 4, Rgba([255; 4]))),
                normal: None,
                occlusion_roughness_metallic: None,
                emissive: None,
                format: TextureFormat::Png,
            },
        }
    }

    #[test]
    fn a_sound_level_passes() {
        assert_eq!(level().validate(), Ok(()));
    }

    #[test]
    fn each_broken_rule_is_named() {
        let message = |edit: &dyn Fn(&mut Level)| {
            let mut level = level();
            edit(&mut level);
            level.validate().expect_err("broken")
        };
        assert!(message(&|level| level.budget = 0).contains("1 triangles, over its budget of 0"));
        assert!(message(&|level| level.layers[0].triangles = 2).contains("1 triangles, and 2 in its 1 layers"));
        assert!(message(&|level| level.mesh.uvs[0].x = -1.0).contains("outside of [0, 1]"));
        assert!(message(&|level| level.layers[0].material = LayerMaterial::Source(0)).contains("textures of its own"));
        assert!(message(&|level| level.mesh.normals[0] = Vec3::X * 2.0).contains("normal of vertex 0"));
        assert!(message(&|level| level.textures.normal = Some(RgbImage::new(2, 2))).contains("normal map"));
    }

    #[test]
    fn layers_of_both_kinds_stand_side_by_side() {
        let mut level = level();
        level.budget = 2;
        level.layers.insert(0, LevelLayer { triangles: 1, material: LayerMaterial::Source(1) });
        level.mesh.positions.extend([Vec3::Z; 3]);
        level.mesh.normals.extend([Vec3::Z; 3]);
        level.mesh.uvs.splice(0..0, [Vec2::splat(-7.0); 3]);
        level.mesh.triangles.push([3, 4, 5]);
        assert_eq!(level.validate(), Ok(()), "textures of the source repeat");
        let image = RgbaImage::from_pixel(1, 1, Rgba([9; 4]));
        let texture = Texture::new(&image, [Wrap::Repeat; 2], true);
        let red = Material { base_color: Vec4::new(1.0, 0.0, 0.0, 1.0), ..Material::default() };
        let source =
            Model { materials: vec![Material::default(), red], textures: vec![texture], ..Model::empty("source") };
        let model = level.to_model(&source);
        assert_eq!(model.surface.material, [1, 2]);
        assert_eq!(model.materials[1].base_color, Vec4::new(1.0, 0.0, 0.0, 1.0));
        assert_eq!(model.materials[2].base_color_texture.map(|texture| texture.texture), Some(1));
        assert_eq!(model.textures.len(), 2);
        level.mesh.triangles.swap(0, 1);
        assert!(level.validate().expect_err("broken").contains("outside of [0, 1]"));
    }
}
