//! Colours of pixels of a source's triangles.

use glam::{Vec3, Vec4, Vec4Swizzles};

use super::raster::{barycentric_at, barycentric_coefficients, pixel_to_ndc, to_pixels};
use super::surface_sampler::{Footprint, SurfaceSampler};
use crate::data::linear_to_srgb;

/// The triangle of a shader that has shaded no pixel.
const NO_TRIANGLE: usize = usize::MAX;

/// The light of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// The base colour alone; the emitted colour for a material that only emits.
    None,
    /// A lamp at the camera: `0.3 + 0.7 |n . v|` of the base colour.
    Head,
    /// A red, a green and a blue lamp along the axes: `0.65 + 0.35 n` of the base colour, with `|n|` on what is seen from
    /// both sides. A point of a surface looks the same from everywhere.
    Axes,
}

/// Shades pixels. Keeps the set-up of the last triangle.
pub(super) struct Shader<'a, 's> {
    sampler: &'a SurfaceSampler<'s>,
    /// Corners in clip space.
    clip: &'a [Vec4],
    /// Side of the image in pixels.
    size: usize,
    eye: Vec3,
    /// The last triangle, or [`NO_TRIANGLE`].
    last: usize,
    coefficients: [Vec3; 3],
    footprint: Footprint,
}

impl<'a, 's> Shader<'a, 's> {
    /// A shader of triangles with corners at `clip`, in an image of `size` pixels seen from `eye`.
    pub(super) fn new(sampler: &'a SurfaceSampler<'s>, clip: &'a [Vec4], size: usize, eye: Vec3) -> Self {
        Self {
            sampler,
            clip,
            size,
            eye,
            last: NO_TRIANGLE,
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

    /// Colour without light, and alpha, of triangle `t` at a pixel, in linear light.
    pub(super) fn color(&mut self, t: usize, x: usize, y: usize) -> Vec4 {
        let b = self.barycentric(t, x, y);
        self.sampler.color(t, b, self.footprint)
    }

    /// Lit and encoded colour, and alpha, of triangle `t` at a pixel, under each of the lights; not premultiplied.
    pub(super) fn shade<const N: usize>(&mut self, t: usize, (x, y): (usize, usize), lights: [Light; N]) -> [Vec4; N] {
        let b = self.barycentric(t, x, y);
        let color = self.sampler.color(t, b, self.footprint);
        lights.map(|light| {
            let rgb = color.xyz() * self.light_at(t, b, light);
            Vec3::from(rgb.to_array().map(encode)).extend(color.w.clamp(0.0, 1.0))
        })
    }

    /// The factor of a colour under a light, at barycentric coordinates `b` of triangle `t`.
    fn light_at(&self, t: usize, b: Vec3, light: Light) -> Vec3 {
        match light {
            _ if light == Light::None || self.sampler.material(t).only_emits() => Vec3::ONE,
            Light::Axes => {
                let normal = self.sampler.normal(t, b, self.footprint);
                let shown = if self.sampler.material(t).double_sided { normal.abs() } else { normal };
                Vec3::splat(0.65) + 0.35 * shown
            }
            Light::None | Light::Head => {
                let surface = &self.sampler.model().surface;
                let [i, j, k] = surface.triangles[t].map(|v| surface.positions[v as usize]);
                let view = (self.eye - (i * b.x + j * b.y + k * b.z)).normalize_or_zero();
                let normal = self.sampler.normal(t, b, self.footprint);
                Vec3::splat(0.3 + 0.7 * normal.dot(view).abs())
            }
        }
    }
}

/// Linear light to sRGB by a table with linear interpolation; within 2e-4 of the exact curve above 1/4096.
fn encode(c: f32) -> f32 {
    const STEPS: usize = 4096;
    static TABLE: std::sync::LazyLock<Vec<f32>> =
        std::sync::LazyLock::new(|| (0..=STEPS).map(|i| linear_to_srgb(i as f32 / STEPS as f32)).collect());
    let table: &[f32] = &TABLE;
    let x = c.clamp(0.0, 1.0) * STEPS as f32;
    let i = (x as usize).min(STEPS - 1);
    table[i] + (table[i + 1] - table[i]) * (x - i as f32)
}
