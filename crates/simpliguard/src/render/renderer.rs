//! Renders images of a model: first opaque and alpha-tested surfaces, then blended ones in the order of the source.

use glam::{Vec3, Vec4, Vec4Swizzles};

use super::camera::Camera;
use super::image::Image;
use super::raster::{EMPTY_PIXEL, Raster, Rect};
use super::shader::{Light, Shader};
use super::surface_sampler::SurfaceSampler;
use crate::data::AlphaMode;

/// Draws one model from many cameras. Its buffers are reused; each thread has its own renderer.
pub struct Renderer<'a> {
    sampler: &'a SurfaceSampler<'a>,
    raster: Raster,
    /// Encoded, premultiplied colour of each sample, for each light of the last images.
    colors: Vec<Vec<Vec4>>,
    /// Vertices of the last image in clip space, kept for their memory.
    clip: Vec<Vec4>,
    /// Samples along each side of a pixel.
    samples: usize,
}

impl<'a> Renderer<'a> {
    /// A renderer of images with a side of `size` pixels, each the mean of `samples` x `samples` points.
    pub fn new(sampler: &'a SurfaceSampler<'a>, size: usize, samples: usize) -> Self {
        let fine = size * samples;
        Self { sampler, raster: Raster::new(fine), colors: Vec::new(), clip: Vec::new(), samples }
    }

    /// The image of the model from `camera`, under each of the lights.
    pub fn draw<const N: usize>(&mut self, camera: &Camera, lights: [Light; N]) -> [Image; N] {
        self.draw_moved(&self.sampler.model().surface.positions, camera, lights)
    }

    /// As [`draw`](Self::draw), with the vertices at `positions`. They are lit as if they had not moved.
    pub fn draw_moved<const N: usize>(
        &mut self,
        positions: &[Vec3],
        camera: &Camera,
        lights: [Light; N],
    ) -> [Image; N] {
        let mut clip = std::mem::take(&mut self.clip);
        camera.project_into(positions, &mut clip);
        let rect = Rect::around(&clip, self.raster.size, self.samples).aligned(self.samples);
        self.raster.clear(rect);
        self.clear_colors(rect, N);
        draw_opaque(self.sampler, &mut self.raster, &clip);
        self.shade_opaque(&clip, rect, camera, lights);
        self.blend(&clip, camera, lights);
        self.clip = clip;
        std::array::from_fn(|light| self.resolve(rect, light))
    }

    fn clear_colors(&mut self, rect: Rect, lights: usize) {
        let size = self.raster.size;
        while self.colors.len() < lights {
            self.colors.push(vec![Vec4::ZERO; size * size]);
        }
        for colors in &mut self.colors[..lights] {
            for row in rect.rows().map(|y| y * size) {
                colors[row + rect.x0..row + rect.x1.max(rect.x0)].fill(Vec4::ZERO);
            }
        }
    }

    /// The opaque or masked triangle that the last image shows at a pixel, at one of its points; `None` if there is none.
    /// Blended triangles in front of it do not count.
    pub fn solid_triangle(&self, x: usize, y: usize) -> Option<usize> {
        let n = self.samples;
        let id = self.raster.ids[y * n * self.raster.size + x * n];
        (id != EMPTY_PIXEL).then_some(id as usize)
    }

    /// Shades the pixels of the visibility buffer.
    fn shade_opaque<const N: usize>(&mut self, clip: &[Vec4], rect: Rect, camera: &Camera, lights: [Light; N]) {
        let size = self.raster.size;
        let mut shader = Shader::new(self.sampler, clip, size, camera.eye);
        for y in rect.rows() {
            for x in rect.columns() {
                let id = self.raster.ids[y * size + x];
                if id != EMPTY_PIXEL {
                    let shaded = shader.shade(id as usize, (x, y), lights);
                    self.colors.iter_mut().zip(shaded).for_each(|(colors, c)| colors[y * size + x] = c.with_w(1.0));
                }
            }
        }
    }

    /// Draws the blended triangles, in the order of the source.
    fn blend<const N: usize>(&mut self, clip: &[Vec4], camera: &Camera, lights: [Light; N]) {
        let model = self.sampler.model();
        if model.materials.iter().all(|m| m.alpha_mode != AlphaMode::Blend) {
            return;
        }
        let size = self.raster.size;
        let pixels = self.raster.pixel_corners(clip);
        let mut shader = Shader::new(self.sampler, clip, size, camera.eye);
        let buffers = &mut self.colors;
        for (t, triangle) in model.surface.triangles.iter().enumerate() {
            let material = self.sampler.material(t);
            if material.alpha_mode != AlphaMode::Blend {
                continue;
            }
            let corners = triangle.map(|v| pixels[v as usize]);
            self.raster.draw_tested(t, corners, material.double_sided, |i, x, y| {
                for (colors, color) in buffers.iter_mut().zip(shader.shade(t, (x, y), lights)) {
                    let over = (color.xyz() * color.w).extend(color.w);
                    colors[i] = over + colors[i] * (1.0 - color.w);
                }
                false
            });
        }
    }

    /// The image under one of the lights, each pixel the mean of its samples.
    fn resolve(&self, rect: Rect, light: usize) -> Image {
        let (n, fine) = (self.samples, self.raster.size);
        let size = fine / n;
        let scale = 255.0 / (n * n) as f32;
        let mut pixels = vec![[0; 4]; size * size];
        for y in rect.y0 / n..rect.y1 / n {
            for x in rect.x0 / n..rect.x1 / n {
                let mut sum = Vec4::ZERO;
                for row in 0..n {
                    let start = (y * n + row) * fine + x * n;
                    sum += self.colors[light][start..start + n].iter().sum::<Vec4>();
                }
                pixels[y * size + x] = (sum * scale + 0.5).to_array().map(|c| c as u8);
            }
        }
        Image { size, pixels }
    }
}

/// Draws everything that hides what is behind it: opaque triangles, and masked ones where they are not cut out.
fn draw_opaque(sampler: &SurfaceSampler<'_>, raster: &mut Raster, clip: &[Vec4]) {
    let model = sampler.model();
    let size = raster.size;
    if model.materials.iter().all(|m| m.alpha_mode == AlphaMode::Opaque) {
        raster.draw(clip, &model.surface.triangles, |t| sampler.material(t).double_sided);
        return;
    }
    let mut shader: Option<Shader<'_, '_>> = None;
    let pixels = raster.pixel_corners(clip);
    for (t, triangle) in model.surface.triangles.iter().enumerate() {
        let material = sampler.material(t);
        let corners = triangle.map(|v| pixels[v as usize]);
        match material.alpha_mode {
            AlphaMode::Blend => {}
            AlphaMode::Opaque => raster.draw_tested(t, corners, material.double_sided, |_, _, _| true),
            AlphaMode::Mask { cutoff } => {
                let shader = shader.get_or_insert_with(|| Shader::new(sampler, clip, size, Vec3::ZERO));
                raster.draw_tested(t, corners, material.double_sided, |_, x, y| shader.color(t, x, y).w >= cutoff);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Material, Model, Surface};
    use crate::geometry::BoundingSphere;

    fn card(materials: Vec<Material>) -> Model {
        // One card for each material, the first one farthest from +z.
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
        let [image] = Renderer::new(&sampler, 32, 2).draw(&camera, [light]);
        image.pixels[16 * 32 + 16]
    }

    fn paint(r: f32, alpha: f32, alpha_mode: AlphaMode) -> Material {
        Material { base_color: Vec4::new(r, 0.0, 0.0, alpha), alpha_mode, ..Material::default() }
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
            let fresh = Renderer::new(&sampler, 33, 2).draw(&from(radius), [Light::None]);
            assert_eq!(reused.draw(&from(radius), [Light::None]), fresh);
        }
    }

    #[test]
    fn images_under_several_lights_are_those_under_each() {
        let mut model = card(vec![paint(1.0, 1.0, AlphaMode::Opaque), paint(0.2, 0.5, AlphaMode::Blend)]);
        model.surface.normals.fill(Vec3::new(0.6, 0.0, 0.8));
        let sampler = SurfaceSampler::new(&model);
        let camera = Camera::orbit(&BoundingSphere { centre: Vec3::ZERO, radius: 1.5 }, Vec3::Z, 0.7, 1.0);
        let lights = [Light::Head, Light::None, Light::Axes];
        let one = |light| Renderer::new(&sampler, 32, 2).draw(&camera, [light]);
        let all = Renderer::new(&sampler, 32, 2).draw(&camera, lights);
        assert_eq!(lights.map(one).concat(), all);
        assert!(all[0] != all[1] && all[1] != all[2]);
    }

    #[test]
    fn a_headlight_from_the_front_changes_nothing() {
        let model = card(vec![paint(1.0, 1.0, AlphaMode::Opaque)]);
        assert_eq!(centre_pixel(&model, Light::Head), [255, 0, 0, 255]);
    }

    #[test]
    fn each_axis_has_a_lamp_of_its_own() {
        let white = Material { base_color: Vec4::ONE, ..Material::default() };
        let facing = |normal: Vec3, double_sided| {
            let mut model = card(vec![Material { double_sided, ..white.clone() }]);
            model.surface.normals.fill(normal);
            centre_pixel(&model, Light::Axes)
        };
        let (dark, middle) = (149, 211);
        assert_eq!(facing(Vec3::Z, false), [middle, middle, 255, 255]);
        assert_eq!(facing(Vec3::NEG_X, false), [dark, middle, middle, 255]);
        assert_eq!(facing(Vec3::NEG_X, true), [255, middle, middle, 255]);
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
