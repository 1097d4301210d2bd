//! What the vertices of a source carry, in units of length: so the error of an attribute adds to that of the shape.

use glam::{Vec2, Vec3, Vec4};

use crate::data::{AlphaMode, Material, Model, Texture, TextureRef, area_vector};

/// Two sets of texture coordinates, a normal and a colour.
pub(super) const COUNT: usize = 11;
/// Attributes in radii of the bounding sphere.
pub(super) type Values = [f32; COUNT];

/// Radii that a normal of unit length counts on opaque surfaces. More of it spends faces on shades, which vertices of their own
/// keep well enough, instead of on outlines.
const NORMAL: f32 = 0.02;
/// The same on cut-outs and clear surfaces: leaves that face different ways do not become one.
const CLEAR_NORMAL: f32 = 0.2;
/// Radii that a channel of a colour counts from black to white.
const COLOR: f32 = 0.2;

/// The length of a unit of each attribute, by material.
pub(super) struct Scales<'a> {
    model: &'a Model,
    /// Radii for each unit of the texture coordinates; zero where no texture shows them.
    uvs: Vec<[f32; 2]>,
}

impl<'a> Scales<'a> {
    /// Lengths for a model whose bounding sphere has this radius, in metres.
    pub(super) fn new(model: &'a Model, radius: f32) -> Self {
        let finest = model.materials.iter().map(|material| [0, 1].map(|set| finest_texture(model, material, set)));
        let mut sums = vec![[[0.0f64; 2]; 2]; model.materials.len()];
        let surface = &model.surface;
        for (triangle, &material) in surface.triangles.iter().zip(&surface.material) {
            let area = f64::from(area_vector(triangle.map(|v| surface.positions[v as usize])).length());
            for (set, sum) in sums[material as usize].iter_mut().enumerate().filter(|(set, _)| has_uvs(model, *set)) {
                let [a, b, c] = triangle.map(|v| surface.uvs[set][v as usize]);
                *sum = [sum[0] + area, sum[1] + f64::from((b - a).perp_dot(c - a).abs())];
            }
        }
        // In a palette, whole parts show one texel. Another one is another colour.
        let scale = |[area, uv]: [f64; 2], texels: f32| ((area / uv).sqrt() as f32 / radius).min(COLOR * texels);
        let scales = finest.zip(sums).map(|(texels, sums)| [0, 1].map(|set| scale(sums[set], texels[set])));
        Self { model, uvs: scales.collect() }
    }

    /// The attributes of a vertex under a material; without its normal if that follows from its faces.
    pub(super) fn values(&self, vertex: u32, material: u32, is_flat: bool) -> Values {
        let (surface, v) = (&self.model.surface, vertex as usize);
        let [first, second] = [0, 1].map(|set| {
            let uv = surface.uvs[set].get(v).copied().unwrap_or_default();
            uv * self.uvs[material as usize][set]
        });
        let normal = surface.normals[v] * if is_flat { 0.0 } else { self.normal(material) };
        let color = surface.colors.get(v).copied().unwrap_or(Vec4::ONE) * COLOR;
        let mut values = [0.0; COUNT];
        values[0..2].copy_from_slice(&first.to_array());
        values[2..4].copy_from_slice(&second.to_array());
        values[4..7].copy_from_slice(&normal.to_array());
        values[7..11].copy_from_slice(&color.to_array());
        values
    }

    /// The texture coordinates that values stand for; `None` for a set that no texture shows.
    pub(super) fn uv(&self, values: &Values, material: u32, set: usize) -> Option<Vec2> {
        let scale = self.uvs[material as usize][set];
        (scale > 0.0).then(|| Vec2::from_slice(&values[2 * set..]) / scale)
    }

    /// The normal that values stand for; `None` if no light is reflected, or if it has no direction.
    pub(super) fn normal_of(values: &Values) -> Option<Vec3> {
        Vec3::from_slice(&values[4..7]).try_normalize()
    }

    /// The colour that values stand for, 0 to 1.
    pub(super) fn color_of(values: &Values) -> Vec4 {
        (Vec4::from_slice(&values[7..11]) / COLOR).clamp(Vec4::ZERO, Vec4::ONE)
    }

    fn normal(&self, material: u32) -> f32 {
        let material = &self.model.materials[material as usize];
        match material.alpha_mode {
            _ if material.unlit => 0.0,
            AlphaMode::Opaque => NORMAL,
            AlphaMode::Mask { .. } | AlphaMode::Blend => CLEAR_NORMAL,
        }
    }
}

fn has_uvs(model: &Model, set: usize) -> bool {
    !model.surface.uvs[set].is_empty()
}

/// The largest side, in texels, of a material's textures on a set of texture coordinates; zero without one.
fn finest_texture(model: &Model, material: &Material, set: usize) -> f32 {
    let Material { base_color_texture, metallic_roughness_texture, normal_texture, .. } = material;
    let textures = [
        base_color_texture,
        metallic_roughness_texture,
        normal_texture,
        &material.occlusion_texture,
        &material.emissive_texture,
    ];
    let on_set = textures.into_iter().flatten().filter(|texture: &&TextureRef| texture.uv_set == set);
    let sides = on_set.filter_map(|texture| model.textures.get(texture.texture)).flat_map(Texture::size);
    sides.max().unwrap_or(0) as f32
}
