//! Forward pass: visibility, texture lookup, antialiasing of silhouettes.
//!
//! Antialiasing after nvdiffrast (Laine et al. 2020): where two neighbouring pixels see different triangles and a
//! silhouette edge passes between their centres, the nearer colour is blended into the farther one by how far it reaches
//! ([`super::silhouettes`]).
//!
//! Limit: edges where two faces intersect are no silhouettes and get neither blending nor gradient.

use std::ops::Range;

use glam::{Mat4, Vec2, Vec3, Vec4};

use super::lookup::Lookup;
use super::low_poly::{CUTOFF, LowPoly, TexelGrid};
use super::silhouettes::Silhouettes;
use crate::render::raster::{barycentric_at, barycentric_coefficients, pixel_to_ndc};
use crate::render::{Camera, EMPTY_PIXEL, Raster, Rect};

/// Buffers of one view, reused from step to step.
pub(super) struct FrameBuffers {
    /// Side in pixels.
    pub(super) size: usize,
    /// Camera and pose of the view.
    pub(super) view_projection: Mat4,
    pub(super) pose: Option<usize>,
    /// Pixels that the mesh or the source may touch.
    pub(super) rect: Rect,
    pub(super) raster: Raster,
    /// Clip-space position of each vertex.
    pub(super) clip: Vec<Vec4>,
    /// Homogeneous barycentric coefficients of each triangle.
    pub(super) coefficients: Vec<[Vec3; 3]>,
    /// Colours before antialiasing: premultiplied RGBA, zero where nothing is seen. Empty until they are looked up.
    pub(super) base: Vec<Vec4>,
    /// Colours after it. Empty until then.
    pub(super) image: Vec<Vec4>,
    /// Silhouette edges, and the blends across them.
    pub(super) silhouettes: Silhouettes,
}

impl FrameBuffers {
    /// For views of `size` x `size` pixels.
    pub(super) fn new(size: usize) -> Self {
        Self {
            size,
            view_projection: Mat4::IDENTITY,
            pose: None,
            rect: Rect { x0: 0, y0: 0, x1: 0, y1: 0 },
            raster: Raster::new(size),
            clip: Vec::new(),
            coefficients: Vec::new(),
            base: Vec::new(),
            image: Vec::new(),
            silhouettes: Silhouettes::default(),
        }
    }

    /// Finds visibility alone: ids, depth and barycentric coefficients. `source` is the rectangle that the source covers.
    pub(super) fn rasterise(&mut self, low: &LowPoly, camera: &Camera, pose: Option<usize>, source: Rect) {
        self.project(low, camera, pose, source);
        match low.texture.opacity.is_empty() {
            true => self.raster.draw(&self.clip, &low.triangles, |_| low.double_sided),
            false => self.draw_cut_out(low, |_, _| true),
        }
    }

    /// As [`Self::rasterise`], with clear texels too.
    pub(super) fn rasterise_whole(&mut self, low: &LowPoly, camera: &Camera, pose: Option<usize>, source: Rect) {
        self.project(low, camera, pose, source);
        self.raster.draw(&self.clip, &low.triangles, |_| low.double_sided);
    }

    fn project(&mut self, low: &LowPoly, camera: &Camera, pose: Option<usize>, source: Rect) {
        (self.view_projection, self.pose) = (camera.view_projection, pose);
        low.motions.project(&low.positions, &self.view_projection, pose, &mut self.clip);
        let own = Rect::around(&self.clip, self.size, 2);
        self.rect = Rect {
            x0: own.x0.min(source.x0),
            y0: own.y0.min(source.y0),
            x1: own.x1.max(source.x1),
            y1: own.y1.max(source.y1),
        };
        self.raster.clear(self.rect);
        self.coefficients.clear();
        let clip = &self.clip;
        self.coefficients.extend(low.triangles.iter().map(|t| barycentric_coefficients(t.map(|v| clip[v as usize]))));
    }

    /// As [`Self::rasterise`], without the triangles that `hidden` has: one id for each pixel.
    pub(super) fn rasterise_behind(
        &mut self,
        low: &LowPoly,
        camera: &Camera,
        pose: Option<usize>,
        (source, hidden): (Rect, &[u32]),
    ) {
        self.project(low, camera, pose, source);
        self.draw_cut_out(low, |t, pixel| hidden[pixel] != t as u32);
    }

    /// Draws the triangles where their texture is not clear and `shows(triangle, pixel)` holds.
    fn draw_cut_out(&mut self, low: &LowPoly, shows: impl Fn(usize, usize) -> bool) {
        let Self { size, raster, clip, coefficients, .. } = self;
        let TexelGrid { size: side, opacity, .. } = &low.texture;
        let pixels = raster.pixel_corners(clip);
        // From front to back, so that most of what is hidden needs no lookup.
        let nearest =
            |t: &usize| low.triangles[*t].map(|v| pixels[v as usize].z).into_iter().fold(f32::INFINITY, f32::min);
        let mut order: Vec<usize> = (0..low.triangles.len()).collect();
        order.sort_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        for t in order {
            let corners = low.triangles[t].map(|v| pixels[v as usize]);
            let [u, v, w] = low.uvs[t];
            raster.draw_tested(t, corners, low.double_sided, |i, x, y| {
                let (b, _) = barycentric_at(&coefficients[t], pixel_to_ndc(x, *size), pixel_to_ndc(y, *size));
                let lookup = Lookup::new(u * b.x + v * b.y + w * b.z, *side);
                shows(t, i) && lookup.opacity(opacity, *side) >= CUTOFF
            });
        }
    }

    /// Runs the whole forward pass.
    pub(super) fn render(&mut self, low: &LowPoly, camera: &Camera, pose: Option<usize>, source: Rect) {
        self.rasterise(low, camera, pose, source);
        self.shade(low);
        self.find_blends(low);
        self.blend();
    }

    /// The forward pass without antialiasing: [`Self::base`] is the result.
    pub(super) fn render_aliased(&mut self, low: &LowPoly, camera: &Camera, pose: Option<usize>, source: Rect) {
        self.rasterise(low, camera, pose, source);
        self.shade(low);
    }

    /// Indices of the pixels of row `y` within the rectangle.
    #[inline]
    pub(super) fn span(&self, y: usize) -> Range<usize> {
        let row = y * self.size;
        row + self.rect.x0..row + self.rect.x1.max(self.rect.x0)
    }

    /// Texture coordinates, in texels, at a pixel of triangle `t` that lies at `ndc` in normalised device coordinates; with
    /// the barycentric coordinates and the inverse of the sum of the homogeneous ones.
    #[inline]
    pub(super) fn uv_at(&self, low: &LowPoly, t: usize, ndc: Vec2) -> (Vec2, Vec3, f32) {
        let (b, inverse) = barycentric_at(&self.coefficients[t], ndc.x, ndc.y);
        let [u, v, w] = &low.uvs[t];
        (*u * b.x + *v * b.y + *w * b.z, b, inverse)
    }

    /// Looks the texture up at every pixel.
    fn shade(&mut self, low: &LowPoly) {
        let TexelGrid { size, ref texels, .. } = low.texture;
        self.base.resize(self.size * self.size, Vec4::ZERO);
        for y in self.rect.rows() {
            let ndc_y = pixel_to_ndc(y, self.size);
            for x in self.rect.columns() {
                let i = y * self.size + x;
                let id = self.raster.ids[i];
                self.base[i] = if id == EMPTY_PIXEL {
                    Vec4::ZERO
                } else {
                    let ndc = Vec2::new(pixel_to_ndc(x, self.size), ndc_y);
                    let uv = self.uv_at(low, id as usize, ndc).0;
                    Lookup::new(uv, size).sample(texels, size)
                };
            }
        }
    }

    /// Finds where silhouette edges pass between neighbouring pixels.
    pub(super) fn find_blends(&mut self, low: &LowPoly) {
        self.silhouettes.find(low, &self.clip, &self.raster, self.rect);
    }

    /// Applies the blends to the base colours.
    fn blend(&mut self) {
        self.image.resize(self.size * self.size, Vec4::ZERO);
        for y in self.rect.rows() {
            let span = self.span(y);
            self.image[span.clone()].copy_from_slice(&self.base[span]);
        }
        for blend in &self.silhouettes.blends {
            let (near, far) = (blend.near as usize, blend.far as usize);
            let difference = self.base[near] - self.base[far];
            if blend.reach < 0.5 {
                self.image[near] -= difference * (0.5 - blend.reach);
            } else {
                self.image[far] += difference * (blend.reach - 0.5);
            }
        }
    }
}
