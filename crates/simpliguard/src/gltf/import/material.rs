//! Materials in the metallic-roughness model, and the textures that they refer to.

use std::collections::BTreeMap;

use glam::{Affine2, Mat2, Vec2, Vec3, Vec4};

use super::asset::Asset;
use super::schema::{self, Root, TextureInfo};
use crate::Error;
use crate::data::{AlphaMode, Material, TextureRef, Transmission, Wrap};

/// An image with a sampler and a colour space: one texture of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct TextureUse {
    /// Index into the glTF's `images`.
    pub(super) image: usize,
    pub(super) srgb: bool,
    /// Wrap modes along u and v.
    pub(super) wrap: [Wrap; 2],
}

/// The wrap mode of a glTF code; unknown ones repeat.
fn wrap_mode(code: Option<u32>) -> Wrap {
    match code {
        Some(33071) => Wrap::Clamp,
        Some(33648) => Wrap::Mirror,
        _ => Wrap::Repeat,
    }
}

/// The used materials and their textures.
#[derive(Debug, Default)]
pub(super) struct Materials {
    pub(super) materials: Vec<Material>,
    /// For each model material, the two `TEXCOORD_n` that become the surface's two sets.
    pub(super) uv_sets: Vec<[usize; 2]>,
    /// Indexed by [`TextureRef::texture`].
    pub(super) textures: Vec<TextureUse>,
    /// Notes for the report.
    pub(super) notes: Vec<String>,
}

/// Reads the materials `used` (glTF indices; `None` is the default material), in that order.
pub(super) fn read(asset: Asset<'_>, root: &Root<'_>, used: &[Option<usize>]) -> Result<Materials, Error> {
    let mut collector = Collector { asset, root, known: BTreeMap::new(), out: Materials::default() };
    for &index in used {
        let (material, uv_sets) = match index {
            Some(index) => {
                let (material, uv_sets) = collector.material(asset.item(&root.materials, index, "material")?)?;
                (Material { index: Some(index), uv_sets, ..material }, uv_sets)
            }
            None => (Material::default(), [0, 1]),
        };
        collector.out.materials.push(material);
        collector.out.uv_sets.push(uv_sets);
    }
    Ok(collector.out)
}

/// The place of each glTF material in the model and on the surface. The last entry of both lists stands for no
/// material.
pub(super) struct MaterialSlots {
    /// For each glTF material, its index in the model.
    model_index: Vec<Option<u32>>,
    /// For each glTF material, the two `TEXCOORD_n` that become the surface's two sets.
    uv_sets: Vec<[usize; 2]>,
}

impl MaterialSlots {
    /// Slots for a file of `count` materials, of which `materials` holds those in `used`.
    pub(super) fn of(used: &[Option<usize>], materials: &Materials, count: usize) -> Self {
        let mut out = Self { model_index: vec![None; count + 1], uv_sets: vec![[0, 1]; count + 1] };
        for (k, material) in used.iter().enumerate() {
            let slot = out.slot(*material);
            out.model_index[slot] = Some(k as u32);
            out.uv_sets[slot] = materials.uv_sets[k];
        }
        out
    }

    /// Index in the model of a primitive's material, and its `TEXCOORD_n`.
    pub(super) fn of_primitive(&self, material: Option<usize>) -> (u32, [usize; 2]) {
        let slot = self.slot(material);
        (self.model_index[slot].unwrap_or_default(), self.uv_sets[slot])
    }

    fn slot(&self, material: Option<usize>) -> usize {
        let none = self.uv_sets.len() - 1;
        material.map_or(none, |material| material.min(none))
    }
}

struct Collector<'a> {
    asset: Asset<'a>,
    root: &'a Root<'a>,
    known: BTreeMap<TextureUse, usize>,
    out: Materials,
}

impl Collector<'_> {
    fn material(&mut self, source: &schema::Material<'_>) -> Result<(Material, [usize; 2]), Error> {
        let pbr = &source.pbr_metallic_roughness;
        let mut material = Material {
            name: source.name.to_owned(),
            alpha_mode: alpha_mode(source),
            double_sided: source.double_sided,
            unlit: source.extensions.unlit.is_some(),
            emissive: emissive(source),
            transmission: transmission(&source.extensions),
            ..Material::default()
        };
        let (mut base_color, mut metallic_roughness) = (&pbr.base_color_texture, &pbr.metallic_roughness_texture);
        if let Some(specular) = &source.extensions.specular_glossiness {
            (base_color, metallic_roughness) = (&specular.diffuse_texture, &None);
            material.base_color = unit4(specular.diffuse_factor);
            material.metallic = 0.0;
            material.roughness = 1.0 - unit(specular.glossiness_factor);
            self.note("a specular-glossiness material is approximated by its diffuse colour and glossiness");
        } else {
            material.base_color = unit4(pbr.base_color_factor);
            material.metallic = unit(pbr.metallic_factor);
            material.roughness = unit(pbr.roughness_factor);
        }
        let (normal, occlusion) = (&source.normal_texture, &source.occlusion_texture);
        material.normal_scale = normal.as_ref().and_then(|info| info.scale).filter(|s| s.is_finite()).unwrap_or(1.0);
        material.occlusion_strength = unit(occlusion.as_ref().and_then(|info| info.strength));

        let infos = [base_color, metallic_roughness, normal, occlusion, &source.emissive_texture];
        let uv_sets = self.uv_sets(&infos);
        let mut slot = |info: &Option<TextureInfo>, srgb| self.texture(info.as_ref(), srgb, uv_sets);
        material.base_color_texture = slot(base_color, true)?;
        material.metallic_roughness_texture = slot(metallic_roughness, false)?;
        material.normal_texture = slot(normal, false)?;
        material.occlusion_texture = slot(occlusion, false)?;
        material.emissive_texture = slot(&source.emissive_texture, true)?;
        Ok((material, uv_sets))
    }

    /// The two `TEXCOORD_n` that a material gets: 0 and 1, unless it uses higher ones.
    fn uv_sets(&mut self, infos: &[&Option<TextureInfo>]) -> [usize; 2] {
        let mut sets: Vec<usize> = infos.iter().filter_map(|info| info.as_ref().map(uv_set)).collect();
        sets.sort_unstable();
        sets.dedup();
        match sets[..] {
            [] | [0] | [1] | [0, 1] => [0, 1],
            [only] => [only, 1],
            [a, b] => [a, b],
            [a, b, ..] => {
                self.note(
                    "a material uses more than two sets of texture coordinates; textures on the others are left out",
                );
                [a, b]
            }
        }
    }

    fn texture(
        &mut self,
        info: Option<&TextureInfo>,
        srgb: bool,
        uv_sets: [usize; 2],
    ) -> Result<Option<TextureRef>, Error> {
        let Some(info) = info else { return Ok(None) };
        let Some(uv_set) = uv_sets.iter().position(|&set| set == uv_set(info)) else { return Ok(None) };
        let texture = self.asset.item(&self.root.textures, info.index, "texture")?;
        let Some(image) = texture.extensions.webp.as_ref().and_then(|webp| webp.source).or(texture.source) else {
            self.note("a texture without an image is left out");
            return Ok(None);
        };
        self.asset.item(&self.root.images, image, "image")?;
        let sampler = match texture.sampler {
            Some(sampler) => Some(self.asset.item(&self.root.samplers, sampler, "sampler")?),
            None => None,
        };
        let wrap = sampler.map_or([None; 2], |sampler| [sampler.wrap_s, sampler.wrap_t]).map(wrap_mode);
        let texture = TextureUse { image, srgb, wrap };
        let textures = &mut self.out.textures;
        let index = *self.known.entry(texture).or_insert_with(|| {
            textures.push(texture);
            textures.len() - 1
        });
        Ok(Some(TextureRef { texture: index, uv_set, transform: transform(info) }))
    }

    fn note(&mut self, note: &str) {
        if !self.out.notes.iter().any(|known| known == note) {
            self.out.notes.push(note.to_owned());
        }
    }
}

fn uv_set(info: &TextureInfo) -> usize {
    info.extensions.transform.as_ref().and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord)
}

/// `KHR_texture_transform`: scale, then rotation, then translation. A positive angle rotates v towards u.
fn transform(info: &TextureInfo) -> Affine2 {
    let Some(transform) = &info.extensions.transform else { return Affine2::IDENTITY };
    let (scale, angle) = (Vec2::from(transform.scale.unwrap_or([1.0; 2])), transform.rotation);
    let (sin, cos) = (libm::sinf(angle), libm::cosf(angle));
    let matrix = Mat2::from_cols(Vec2::new(cos, -sin) * scale.x, Vec2::new(sin, cos) * scale.y);
    let affine = Affine2::from_mat2_translation(matrix, transform.offset.unwrap_or_default().into());
    if affine.is_finite() { affine } else { Affine2::IDENTITY }
}

fn alpha_mode(source: &schema::Material<'_>) -> AlphaMode {
    match source.alpha_mode {
        Some("MASK") => {
            AlphaMode::Mask { cutoff: source.alpha_cutoff.filter(|cutoff| cutoff.is_finite()).unwrap_or(0.5) }
        }
        Some("BLEND") => AlphaMode::Blend,
        _ => AlphaMode::Opaque,
    }
}

/// Emissive factor times strength.
fn emissive(source: &schema::Material<'_>) -> Vec3 {
    let strength = source.extensions.emissive_strength.as_ref().and_then(|ext| ext.emissive_strength).unwrap_or(1.0);
    let emissive = Vec3::from(source.emissive_factor.unwrap_or_default()) * strength;
    if emissive.is_finite() { emissive.max(Vec3::ZERO) } else { Vec3::ZERO }
}

/// Light that passes through; `None` for a factor of zero.
fn transmission(extensions: &schema::MaterialExtensions) -> Option<Transmission> {
    let factor = extensions.transmission.as_ref()?.transmission_factor.unwrap_or(0.0).clamp(0.0, 1.0);
    let volume = extensions.volume.as_ref();
    let ior = extensions.ior.as_ref().and_then(|ext| ext.ior).filter(|ior| *ior >= 1.0);
    let distance = volume.and_then(|volume| volume.attenuation_distance).filter(|distance| *distance > 0.0);
    let color = Vec3::from(volume.and_then(|volume| volume.attenuation_color).unwrap_or([1.0; 3]));
    (factor > 0.0).then(|| Transmission {
        factor,
        ior: ior.unwrap_or(1.5),
        thickness: volume.and_then(|volume| volume.thickness_factor).filter(|t| t.is_finite()).unwrap_or(0.0).max(0.0),
        attenuation_distance: distance.unwrap_or(f32::INFINITY),
        attenuation_color: color.clamp(Vec3::ZERO, Vec3::ONE),
    })
}

fn unit(factor: Option<f32>) -> f32 {
    factor.unwrap_or(1.0).clamp(0.0, 1.0)
}

fn unit4(factor: Option<[f32; 4]>) -> Vec4 {
    Vec4::from(factor.unwrap_or([1.0; 4])).clamp(Vec4::ZERO, Vec4::ONE)
}
