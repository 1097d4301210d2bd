//! Shaded pictures of a model: opaque and alpha-tested surfaces first, then blended ones in the source's order.

use glam::{Vec3, Vec4, Vec4Swizzles};
use image::{Rgba, RgbaImage};

use super::raster::{EMPTY_PIXEL, Raster, Rect, barycentric_at, barycentric_coefficients, pixel_to_ndc, to_pixels};
use super::two_by_two::two_by_two;
use super::{Camera, Footprint, SurfaceSampler};
use crate::data::{AlphaMode, linear_to_srgb};

/// How a picture is lit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// Base colour alone, or what is emitted where nothing else is seen.
    None,
    /// A lamp at the camera: `0.3 + 0.7 |n . v|` of the base colour.
    Head,
}

/// A square image, sRGB encoded, colours premultiplied by coverage, rows from the bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Side in pixels.
    pub size: usize,
    /// Encoded, premultiplied RGBA.
    pub pixels: Vec<[u8; 4]>,
}

impl Image {
    /// The pixel as a fraction of full scale.
    #[inline]
    pub fn at(&self, i: usize) -> Vec4 {
        let [r, g, b, a] = self.pixels[i].map(f32::from);
        Vec4::new(r, g, b, a) * (1.0 / 255.0)
    }

    /// At half the size, each pixel the mean of four; `None` if the size is odd.
    pub fn halved(&self) -> Option<Self> {
        let size = self.size.is_multiple_of(2).then_some(self.size / 2)?;
        let pixel = |i: usize| {
            let four = two_by_two(i, self.size).map(|k| self.pixels[k]);
            std::array::from_fn(|lane| ((four.iter().map(|p| u16::from(p[lane])).sum::<u16>() + 2) / 4) as u8)
        };
        Some(Self { size, pixels: (0..size * size).map(pixel).collect() })
    }

    /// Over a background of one encoded grey, rows from the top.
    pub fn over(&self, background: f32) -> RgbaImage {
        RgbaImage::from_fn(self.size as u32, self.size as u32, |x, y| {
            let p = self.at((self.size - 1 - y as usize) * self.size + x as usize);
            let c = p.xyz() + Vec3::splat(background * (1.0 - p.w));
            let [r, g, b] = c.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            Rgba([r, g, b, 255])
        })
    }
}

/// Draws one model from many cameras; one per thread, its buffers are reused.
pub struct Renderer<'a> {
    sampler: &'a SurfaceSampler<'a>,
    raster: Raster,
    colors: Vec<Vec4>,
    samples: usize,
}

impl<'a> Renderer<'a> {
    /// A renderer of pictures of `size` pixels, each the mean of `samples` x `samples` points.
    pub fn new(sampler: &'a SurfaceSampler<'a>, size: usize, samples: usize) -> Self {
        let fine = size * samples;
        Self { sampler, raster: Raster::new(fine), colors: vec![Vec4::ZERO; fine * fine], samples }
    }

    /// The model from `camera`.
    pub fn draw(&mut self, camera: &Camera, light: Light) -> Image {
        self.draw_moved(&self.sampler.model().surface.positions, camera, light)
    }

    /// The model from `camera`, its vertices at `positions`. Light falls as if they had not moved.
    pub fn draw_moved(&mut self, positions: &[Vec3], camera: &Camera, light: Light) -> Image {
        let clip = camera.project(positions);
        let rect = Rect::around(&clip, self.raster.size, self.samples).aligned(self.samples);
        self.raster.clear(rect);
        for y in rect.rows() {
            let row = y * self.raster.size;
            self.colors[row + rect.x0..row + rect.x1.max(rect.x0)].fill(Vec4::ZERO);
        }
        draw_solid(self.sampler, &mut self.raster, &clip);
        self.shade_solid(&clip, rect, camera, light);
        self.blend(&clip, camera, light);
        self.resolve(rect)
    }

    fn shade_solid(&mut self, clip: &[Vec4], rect: Rect, camera: &Camera, light: Light) {
        let size = self.raster.size;
        let mut shader = Shader::new(self.sampler, clip, size, camera, light);
        for y in rect.rows() {
            for x in rect.columns() {
                let id = self.raster.ids[y * size + x];
                if id != EMPTY_PIXEL {
                    self.colors[y * size + x] = shader.shade(id as usize, x, y).with_w(1.0);
                }
            }
        }
    }

    fn blend(&mut self, clip: &[Vec4], camera: &Camera, light: Light) {
        let model = self.sampler.model();
        if model.materials.iter().all(|m| m.alpha_mode != AlphaMode::Blend) {
            return;
        }
        let size = self.raster.size;
        let pixels = self.raster.place(clip);
        let mut shader = Shader::new(self.sampler, clip, size, camera, light);
        let colors = &mut self.colors;
        for (t, triangle) in model.surface.triangles.iter().enumerate() {
            let material = self.sampler.material(t);
            if material.alpha_mode != AlphaMode::Blend {
                continue;
            }
            let corners = triangle.map(|v| pixels[v as usize]);
            self.raster.draw_tested(t, corners, material.double_sided, |i, x, y| {
                let color = shader.shade(t, x, y);
                let over = (color.xyz() * color.w).extend(color.w);
                colors[i] = over + colors[i] * (1.0 - color.w);
                false
            });
        }
    }

    fn resolve(&self, rect: Rect) -> Image {
        let (n, fine) = (self.samples, self.raster.size);
        let size = fine / n;
        let scale = 255.0 / (n * n) as f32;
        let mut pixels = vec![[0; 4]; size * size];
        for y in rect.y0 / n..rect.y1 / n {
            for x in rect.x0 / n..rect.x1 / n {
                let mut sum = Vec4::ZERO;
                for row in 0..n {
                    let start = (y * n + row) * fine + x * n;
                    sum += self.colors[start..start + n].iter().sum::<Vec4>();
                }
                pixels[y * size + x] = (sum * scale + 0.5).to_array().map(|c| c as u8);
            }
        }
        Image { size, pixels }
    }
}

/// Fills `raster` with everything that hides what is behind it: opaque triangles and the opaque parts of masked ones.
pub(crate) fn draw_solid(sampler: &SurfaceSampler<'_>, raster: &mut Raster, clip: &[Vec4]) {
    let model = sampler.model();
    let size = raster.size;
    if model.materials.iter().all(|m| m.alpha_mode == AlphaMode::Opaque) {
        raster.draw(clip, &model.surface.triangles, |t| sampler.material(t).double_sided);
        return;
    }
    let mut shader: Option<Shader<'_, '_>> = None;
    let camera = Camera { view_projection: glam::Mat4::IDENTITY, eye: Vec3::ZERO };
    let pixels = raster.place(clip);
    for (t, triangle) in model.surface.triangles.iter().enumerate() {
        let material = sampler.material(t);
        let corners = triangle.map(|v| pixels[v as usize]);
        match material.alpha_mode {
            AlphaMode::Blend => {}
            AlphaMode::Opaque => raster.draw_tested(t, corners, material.double_sided, |_, _, _| true),
            AlphaMode::Mask { cutoff } => {
                let shader = shader.get_or_insert_with(|| Shader::new(sampler, clip, size, &camera, Light::None));
                raster.draw_tested(t, corners, material.double_sided, |_, x, y| shader.color(t, x, y).w >= cutoff);
            }
        }
    }
}

/// Shades pixels, keeping the set-up of the triangle it saw last.
struct Shader<'a, 's> {
    sampler: &'a SurfaceSampler<'s>,
    clip: &'a [Vec4],
    size: usize,
    eye: Vec3,
    light: Light,
    last: usize,
    coefficients: [Vec3; 3],
    footprint: Footprint,
}

impl<'a, 's> Shader<'a, 's> {
    fn new(sampler: &'a SurfaceSampler<'s>, clip: &'a [Vec4], size: usize, camera: &Camera, light: Light) -> Self {
        Self {
            sampler,
            clip,
            size,
            eye: camera.eye,
            light,
            last: usize::MAX,
            coefficients: [Vec3::ZERO; 3],
            footprint: Footprint::new(1.0, 1.0),
        }
    }

    fn barycentric(&mut self, t: usize, x: usize, y: usize) -> Vec3 {
        if self.last != t {
            self.last = t;
            let corners = self.sampler.model().surface.triangles[t].map(|v| self.clip[v as usize]);
            self.coefficients = barycentric_coefficients(corners);
            let [a, b, c] = corners.map(|c| to_pixels(c, self.size).truncate());
            self.footprint = Footprint::new(1.0, 0.5 * (b - a).perp_dot(c - a).abs());
        }
        let (x, y) = (pixel_to_ndc(x, self.size), pixel_to_ndc(y, self.size));
        barycentric_at(&self.coefficients, x, y).0
    }

    fn color(&mut self, t: usize, x: usize, y: usize) -> Vec4 {
        let b = self.barycentric(t, x, y);
        self.sampler.color(t, b, self.footprint)
    }

    /// Encoded colour and alpha, not premultiplied.
    fn shade(&mut self, t: usize, x: usize, y: usize) -> Vec4 {
        let b = self.barycentric(t, x, y);
        let color = self.sampler.color(t, b, self.footprint);
        let rgb = match self.light {
            Light::Head if !self.sampler.material(t).only_emits() => {
                let surface = &self.sampler.model().surface;
                let [i, j, k] = surface.triangles[t].map(|v| surface.positions[v as usize]);
                let view = (self.eye - (i * b.x + j * b.y + k * b.z)).normalize_or_zero();
                let normal = self.sampler.normal(t, b, self.footprint);
                color.xyz() * (0.3 + 0.7 * normal.dot(view).abs())
            }
            Light::None | Light::Head => color.xyz(),
        };
        Vec3::from(rgb.to_array().map(encode)).extend(color.w.clamp(0.0, 1.0))
    }
}

/// Linear to sRGB by table with linear interpolation; within 2e-4 of the exact curve above 1/4096.
fn encode(c: f32) -> f32 {
    const STEPS: usize = 4096;
    static TABLE: std::sync::LazyLock<Vec<f32>> =
        std::sync::LazyLock::new(|| (0..=STEPS).map(|i| linear_to_srgb(i as f32 / STEPS as f32)).collect());
    let table: &[f32] = &TABLE;
    let x = c.clamp(0.0, 1.0) * STEPS as f32;
    let i = (x as usize).min(STEPS - 1);
    table[i] + (table[i + 1] - table[i]) * (x - i as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Material, Model, Surface};
    use crate::geometry::BoundingSphere;

    fn card(materials: Vec<Material>) -> Model {
        // One card per material, the first farthest from +z.
        let mut surface = Surface::default();
        for i in 0..materials.len() as u32 {
            let z = 0.1 * i as f32;
            surface
                .positions
                .extend([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, z)));
            surface.normals.extend([Vec3::Z; 4]);
            surface.triangles.extend([[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
            surface.material.extend([i, i]);
        }
        surface.uvs[0] = vec![glam::Vec2::ZERO; surface.positions.len()];
        Model { surface, materials, ..Model::empty("card") }
    }

    fn centre_pixel(model: &Model, light: Light) -> [u8; 4] {
        let sampler = SurfaceSampler::new(model);
        let camera = Camera::orbit(&BoundingSphere { centre: Vec3::ZERO, radius: 1.5 }, Vec3::Z, 0.7, 1.0);
        Renderer::new(&sampler, 32, 2).draw(&camera, light).pixels[16 * 32 + 16]
    }

    fn paint(r: f32, alpha: f32, alpha_mode: AlphaMode) -> Material {
        Material { base_color: Vec4::new(r, 0.0, 0.0, alpha), alpha_mode, ..Material::default() }
    }

    #[test]
    fn a_picture_of_half_the_size_has_means_of_four() {
        let pixels = (0..16).map(|i| [10 * i, 255, 0, i]).collect();
        let half = Image { size: 4, pixels }.halved().expect("even");
        assert_eq!(half.pixels, [[25, 255, 0, 3], [45, 255, 0, 5], [105, 255, 0, 11], [125, 255, 0, 13]]);
        assert_eq!(Image { size: 1, pixels: vec![[0; 4]] }.halved(), None);
    }

    #[test]
    fn base_colour_is_encoded_to_srgb() {
        let model = card(vec![paint(0.5, 1.0, AlphaMode::Opaque)]);
        assert_eq!(centre_pixel(&model, Light::None), [188, 0, 0, 255]);
    }

    #[test]
    fn a_view_holds_nothing_of_the_one_before() {
        let model = card(vec![paint(1.0, 1.0, AlphaMode::Opaque)]);
        let sampler = SurfaceSampler::new(&model);
        let from = |radius: f32| Camera::orbit(&BoundingSphere { centre: Vec3::ZERO, radius }, Vec3::Z, 0.7, 1.0);
        let mut reused = Renderer::new(&sampler, 33, 2);
        for radius in [1.0, 1.6, 2.1, 3.3] {
            let fresh = Renderer::new(&sampler, 33, 2).draw(&from(radius), Light::None);
            assert_eq!(reused.draw(&from(radius), Light::None), fresh);
        }
    }

    #[test]
    fn a_headlight_from_the_front_changes_nothing() {
        let model = card(vec![paint(1.0, 1.0, AlphaMode::Opaque)]);
        assert_eq!(centre_pixel(&model, Light::Head), [255, 0, 0, 255]);
    }

    #[test]
    fn blended_cards_show_what_is_behind() {
        let model = card(vec![paint(1.0, 1.0, AlphaMode::Opaque), paint(0.0, 0.5, AlphaMode::Blend)]);
        let [red, green, blue, alpha] = centre_pixel(&model, Light::None);
        assert!(red.abs_diff(128) <= 1 && [green, blue, alpha] == [0, 0, 255], "{red}");
    }

    #[test]
    fn masked_cards_are_there_or_not() {
        for (alpha, red) in [(0.4, 255), (0.6, 0)] {
            let front = paint(0.0, alpha, AlphaMode::Mask { cutoff: 0.5 });
            let model = card(vec![paint(1.0, 1.0, AlphaMode::Opaque), front]);
            assert_eq!(centre_pixel(&model, Light::None)[0], red);
        }
    }
}
