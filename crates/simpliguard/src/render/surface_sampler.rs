//! Samples of a source's surface: material factors, textures at the right mip level, normal maps.

use glam::{Mat2, Vec2, Vec3, Vec4, Vec4Swizzles};

use crate::data::{Material, Model, TextureRef, area_vector};

/// Material properties at one point of the surface, in linear light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    /// Colour without light, and alpha: the base colour, or the emitted colour of a material that only emits.
    pub color: Vec4,
    /// True if `color` is emitted.
    pub glows: bool,
    /// Unit shading normal in world space, with the normal map.
    pub normal: Vec3,
    /// The surface is double-sided, and its normals point away from its front, the side that it is seen counter-clockwise from.
    pub is_inverted: bool,
    /// Ambient occlusion, 0 occluded to 1 open.
    pub occlusion: f32,
    /// Roughness, 0 to 1.
    pub roughness: f32,
    /// Metalness, 0 to 1.
    pub metallic: f32,
    /// Light emitted in addition to `color`.
    pub emissive: Vec3,
}

impl SurfaceSample {
    /// The point is not fully clear.
    pub fn is_seen(&self) -> bool {
        self.color.w > 0.0
    }
}

/// Samples a model's surface by triangle and barycentric coordinates.
pub struct SurfaceSampler<'a> {
    model: &'a Model,
    /// log2 of each triangle's area in texture space, for both sets of texture coordinates.
    uv_area: [Vec<f32>; 2],
}

/// The fraction of a triangle's area that one sample stands for: the area of a pixel divided by that of the triangle on
/// screen, or the area of a texel divided by that of the triangle in space. It selects the mip level.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    log2: f32,
}

impl Footprint {
    /// The footprint of a sample; `sample` and `triangle` are areas in the same unit.
    pub fn new(sample: f32, triangle: f32) -> Self {
        Self { log2: libm::log2f((sample / triangle.max(1e-30)).clamp(1e-30, 1e30)) }
    }
}

impl<'a> SurfaceSampler<'a> {
    /// A sampler of `model`, with the mip selection prepared for every triangle.
    pub fn new(model: &'a Model) -> Self {
        let uv_area = [0, 1].map(|set| {
            let uvs = &model.surface.uvs[set];
            if uvs.is_empty() {
                return Vec::new();
            }
            let area = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| uvs[v as usize]);
                libm::log2f((0.5 * (b - a).perp_dot(c - a)).abs().clamp(1e-30, 1e30))
            };
            model.surface.triangles.iter().map(area).collect()
        });
        Self { model, uv_area }
    }

    /// The model that is sampled.
    pub fn model(&self) -> &'a Model {
        self.model
    }

    /// The material of triangle `t`.
    #[inline]
    pub fn material(&self, t: usize) -> &'a Material {
        &self.model.materials[self.model.surface.material[t] as usize]
    }

    /// Colour without light, and alpha, at barycentric coordinates `b` of triangle `t`, in linear light: the base
    /// colour, or the emitted colour of a material that only emits.
    pub fn color(&self, t: usize, b: Vec3, footprint: Footprint) -> Vec4 {
        let base = self.base_color(t, b, footprint);
        if self.material(t).only_emits() { self.emissive(t, b, footprint).extend(base.w) } else { base }
    }

    fn emissive(&self, t: usize, b: Vec3, footprint: Footprint) -> Vec3 {
        let material = self.material(t);
        let texel = |texture: &TextureRef| self.texel(texture, t, b, footprint).xyz();
        material.emissive * material.emissive_texture.as_ref().map_or(Vec3::ONE, texel)
    }

    /// Base colour and alpha at barycentric coordinates `b` of triangle `t`, in linear light.
    fn base_color(&self, t: usize, b: Vec3, footprint: Footprint) -> Vec4 {
        let material = self.material(t);
        let mut color = material.base_color;
        if let Some(texture) = &material.base_color_texture {
            color *= self.texel(texture, t, b, footprint);
        }
        let colors = &self.model.surface.colors;
        if !colors.is_empty() {
            let [i, j, k] = self.model.surface.triangles[t].map(|v| colors[v as usize]);
            color *= i * b.x + j * b.y + k * b.z;
        }
        color
    }

    /// The barycentric coordinates at so many texels of the colour texture from `b`, on the plane of triangle `t`. Those of
    /// `b` itself without a texture.
    pub(crate) fn shifted(&self, t: usize, b: Vec3, texels: Vec2) -> Vec3 {
        let material = self.material(t);
        let texture = if material.only_emits() { &material.emissive_texture } else { &material.base_color_texture };
        let Some(texture) = texture else { return b };
        let size = self.model.textures[texture.texture].size();
        let [o, p, q] = [Vec3::X, Vec3::Y, Vec3::Z].map(|corner| self.uv(texture, t, corner));
        let m = Mat2::from_cols(p - o, q - o);
        if m.determinant().abs() < 1e-12 {
            return b;
        }
        let step = m.inverse() * (texels / Vec2::from(size.map(|side| side as f32)));
        b + Vec3::new(-step.x - step.y, step.x, step.y)
    }

    /// Unit shading normal in world space, with the normal map.
    pub fn normal(&self, t: usize, b: Vec3, footprint: Footprint) -> Vec3 {
        let normal = self.smooth_normal(t, b);
        let material = self.material(t);
        let Some(texture) = &material.normal_texture else { return normal };
        let mapped = self.texel(texture, t, b, footprint).xyz() * 2.0 - 1.0;
        let (tangent, bitangent) = self.tangent_frame(t, b, normal, texture);
        let [x, y] = [mapped.x * material.normal_scale, mapped.y * material.normal_scale];
        (tangent * x + bitangent * y + normal * mapped.z).normalize_or(normal)
    }

    /// Unit normal between those of the corners.
    fn smooth_normal(&self, t: usize, b: Vec3) -> Vec3 {
        let surface = &self.model.surface;
        let [i, j, k] = surface.triangles[t].map(|v| surface.normals[v as usize]);
        (i * b.x + j * b.y + k * b.z).normalize_or(Vec3::Y)
    }

    fn area_vector(&self, t: usize) -> Vec3 {
        let surface = &self.model.surface;
        area_vector(surface.triangles[t].map(|v| surface.positions[v as usize]))
    }

    /// All properties at barycentric coordinates `b` of triangle `t`.
    pub fn sample(&self, t: usize, b: Vec3, footprint: Footprint) -> SurfaceSample {
        let material = self.material(t);
        let texel = |texture: &Option<TextureRef>| {
            texture.as_ref().map_or(Vec4::ONE, |texture| self.texel(texture, t, b, footprint))
        };
        let rough_metal = texel(&material.metallic_roughness_texture);
        let occlusion = texel(&material.occlusion_texture).x;
        let glows = material.only_emits();
        SurfaceSample {
            color: self.color(t, b, footprint),
            glows,
            normal: self.normal(t, b, footprint),
            is_inverted: material.double_sided && self.smooth_normal(t, b).dot(self.area_vector(t)) < 0.0,
            occlusion: 1.0 + material.occlusion_strength * (occlusion - 1.0),
            roughness: material.roughness * rough_metal.y,
            metallic: material.metallic * rough_metal.z,
            emissive: if glows { Vec3::ZERO } else { self.emissive(t, b, footprint) },
        }
    }

    fn texel(&self, texture: &TextureRef, t: usize, b: Vec3, footprint: Footprint) -> Vec4 {
        let uv = self.uv(texture, t, b);
        let image = &self.model.textures[texture.texture];
        let [width, height] = image.size();
        let scale = texture.transform.matrix2.determinant().abs() * width as f32 * height as f32;
        let area = self.uv_area[texture.uv_set].get(t).copied().unwrap_or(0.0);
        image.sample(uv, 0.5 * (area + libm::log2f(scale.clamp(1e-30, 1e30)) + footprint.log2))
    }

    fn uv(&self, texture: &TextureRef, t: usize, b: Vec3) -> Vec2 {
        let uvs = &self.model.surface.uvs[texture.uv_set];
        if uvs.is_empty() {
            return texture.transform.translation;
        }
        let [i, j, k] = self.model.surface.triangles[t].map(|v| uvs[v as usize]);
        texture.transform.transform_point2(i * b.x + j * b.y + k * b.z)
    }

    /// Tangent and bitangent: the source's own if it has them, else from the texture coordinates.
    fn tangent_frame(&self, t: usize, b: Vec3, normal: Vec3, texture: &TextureRef) -> (Vec3, Vec3) {
        let surface = &self.model.surface;
        let corners = surface.triangles[t].map(|v| v as usize);
        if !surface.tangents.is_empty() {
            let [i, j, k] = corners.map(|v| surface.tangents[v]);
            let tangent = i.xyz() * b.x + j.xyz() * b.y + k.xyz() * b.z;
            let tangent = (tangent - normal * normal.dot(tangent)).normalize_or_zero();
            if tangent != Vec3::ZERO {
                return (tangent, normal.cross(tangent) * if i.w < 0.0 { -1.0 } else { 1.0 });
            }
        }
        let uvs = &surface.uvs[texture.uv_set];
        if uvs.is_empty() {
            let tangent = normal.any_orthonormal_vector();
            return (tangent, normal.cross(tangent));
        }
        let [p0, p1, p2] = corners.map(|v| surface.positions[v]);
        let [u0, u1, u2] = corners.map(|v| texture.transform.transform_point2(uvs[v]));
        let m = Mat2::from_cols(u1 - u0, u2 - u0);
        let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
        let tangent = ((p1 - p0) * (u2 - u0).y - (p2 - p0) * (u1 - u0).y) * sign;
        let tangent = (tangent - normal * normal.dot(tangent)).normalize_or(normal.any_orthonormal_vector());
        // Green points up in the image, along -v. A chart that is not mirrored runs clockwise in (u, v), because v
        // grows downwards; its bitangent is n x t.
        (tangent, normal.cross(tangent) * -sign)
    }
}
