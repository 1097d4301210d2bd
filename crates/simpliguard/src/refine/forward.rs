//! Forward pass: visibility, texture lookup, antialiasing of silhouettes.
//!
//! Antialiasing after nvdiffrast (Laine et al. 2020): where two neighbouring pixels see different triangles and a
//! silhouette edge passes between their centres, the nearer colour is blended into the farther by how far it reaches.
//! An edge acts along its minor direction only (horizontally if it is steep): with both, diagonals would count twice.
//!
//! Limit: edges where two faces intersect are no silhouettes and get neither blending nor gradient.

use glam::{Vec2, Vec3, Vec4};

use super::LowPoly;
use super::low_poly::NO_NEIGHBOUR;
use crate::render::raster::{barycentric_at, barycentric_coefficients, pixel_to_ndc, to_pixels};
use crate::render::{Camera, EMPTY_PIXEL, Raster, Rect};

/// Buffers of one view, reused from step to step.
pub(super) struct FrameBuffers {
    pub(super) size: usize,
    /// Pixels that the mesh or the source may touch.
    pub(super) rect: Rect,
    pub(super) raster: Raster,
    pub(super) clip: Vec<Vec4>,
    /// Homogeneous barycentric coefficients of each triangle.
    pub(super) coefficients: Vec<[Vec3; 3]>,
    /// Colours before antialiasing: premultiplied RGBA, zero where nothing is seen.
    pub(super) base: Vec<Vec4>,
    /// Colours after it.
    pub(super) image: Vec<Vec4>,
    /// Blends, in the order they were made.
    pub(super) blends: Vec<Blend>,
    pixels: Vec<Vec2>,
    facing: Vec<bool>,
}

/// One blend across a silhouette edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blend {
    /// The pixel whose triangle owns the edge, and the one beyond it.
    pub(super) near: u32,
    pub(super) far: u32,
    /// Distance from the near pixel's centre to the edge, in pixels towards the far one: 0 to 1.
    pub(super) reach: f32,
    /// The edge.
    pub(super) vertices: [u32; 2],
    /// The pixels are side by side (else one above the other).
    pub(super) horizontal: bool,
    /// +1 if the far pixel follows the near one along that direction.
    pub(super) sign: f32,
}

/// A bilinear lookup: its first texel and the fractions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lookup {
    pub(super) texel: usize,
    pub(super) fx: f32,
    pub(super) fy: f32,
}

impl Lookup {
    #[inline]
    pub(super) fn new(uv: Vec2, size: usize) -> Self {
        let last = size as f32 - 1.001;
        let (x, y) = ((uv.x - 0.5).clamp(0.0, last), (uv.y - 0.5).clamp(0.0, last));
        let (i, j) = (x as usize, y as usize);
        Self { texel: j * size + i, fx: x - i as f32, fy: y - j as f32 }
    }

    /// Weights of the texel, the one to its right, the one below and the one below right.
    #[inline]
    pub(super) fn weights(&self) -> [f32; 4] {
        let (x, y) = (self.fx, self.fy);
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }

    /// What a texture of `size` x `size` texels shows there.
    #[inline]
    pub(super) fn sample(&self, texels: &[Vec4], size: usize) -> Vec4 {
        let [a, b, c, d] = self.weights();
        let k = self.texel;
        texels[k] * a + texels[k + 1] * b + texels[k + size] * c + texels[k + size + 1] * d
    }
}

impl FrameBuffers {
    pub(super) fn new(size: usize) -> Self {
        Self {
            size,
            rect: Rect { x0: 0, y0: 0, x1: 0, y1: 0 },
            raster: Raster::new(size),
            clip: Vec::new(),
            coefficients: Vec::new(),
            base: vec![Vec4::ZERO; size * size],
            image: vec![Vec4::ZERO; size * size],
            blends: Vec::new(),
            pixels: Vec::new(),
            facing: Vec::new(),
        }
    }

    /// Visibility alone: ids, depth and barycentric coefficients. `source` are the pixels that the source covers.
    pub(super) fn rasterise(&mut self, low: &LowPoly, camera: &Camera, pose: Option<usize>, source: Rect) {
        low.motions.project(&low.positions, &camera.view_projection, pose, &mut self.clip);
        let own = Rect::around(&self.clip, self.size, 2);
        self.rect = Rect {
            x0: own.x0.min(source.x0),
            y0: own.y0.min(source.y0),
            x1: own.x1.max(source.x1),
            y1: own.y1.max(source.y1),
        };
        self.raster.clear(self.rect);
        self.raster.draw(&self.clip, &low.triangles, |_| low.double_sided);
        self.coefficients.clear();
        let clip = &self.clip;
        self.coefficients.extend(low.triangles.iter().map(|t| barycentric_coefficients(t.map(|v| clip[v as usize]))));
    }

    /// The whole forward pass.
    pub(super) fn render(&mut self, low: &LowPoly, camera: &Camera, pose: Option<usize>, source: Rect) {
        self.rasterise(low, camera, pose, source);
        self.shade(low);
        self.find_blends(low);
        self.blend();
    }

    /// Texture coordinates seen at a pixel of triangle `t`, with the barycentric ones and the inverse of their sum.
    #[inline]
    pub(super) fn uv_at(&self, low: &LowPoly, t: usize, x: usize, ndc_y: f32) -> (Vec2, Vec3, f32) {
        let (b, inverse) = barycentric_at(&self.coefficients[t], pixel_to_ndc(x, self.size), ndc_y);
        let [u, v, w] = &low.uvs[t];
        (*u * b.x + *v * b.y + *w * b.z, b, inverse)
    }

    fn shade(&mut self, low: &LowPoly) {
        for y in self.rect.rows() {
            let ndc_y = pixel_to_ndc(y, self.size);
            for x in self.rect.columns() {
                let i = y * self.size + x;
                let id = self.raster.ids[i];
                self.base[i] = if id == EMPTY_PIXEL {
                    Vec4::ZERO
                } else {
                    let lookup = Lookup::new(self.uv_at(low, id as usize, x, ndc_y).0, low.size);
                    lookup.sample(&low.texels, low.size)
                };
            }
        }
    }

    pub(super) fn find_blends(&mut self, low: &LowPoly) {
        self.pixels.clear();
        self.pixels.extend(self.clip.iter().map(|&c| to_pixels(c, self.size).truncate()));
        self.facing.clear();
        let pixels = &self.pixels;
        self.facing.extend(low.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| pixels[v as usize]);
            (b - a).perp_dot(c - a) > 0.0
        }));
        self.blends.clear();
        for y in self.rect.rows() {
            for x in self.rect.columns() {
                let i = y * self.size + x;
                if x + 1 < self.rect.x1 {
                    self.blend_between(low, i, i + 1, true);
                }
                if y + 1 < self.rect.y1 {
                    self.blend_between(low, i, i + self.size, false);
                }
            }
        }
    }

    #[inline]
    fn blend_between(&mut self, low: &LowPoly, first: usize, second: usize, horizontal: bool) {
        let (a, b) = (self.raster.ids[first], self.raster.ids[second]);
        if a == b {
            return;
        }
        let first_is_near =
            b == EMPTY_PIXEL || (a != EMPTY_PIXEL && self.raster.depth[first] < self.raster.depth[second]);
        let (near, far, sign) = if first_is_near { (first, second, 1.0) } else { (second, first, -1.0) };
        let t = self.raster.ids[near] as usize;
        let centre = Vec2::new((near % self.size) as f32, (near / self.size) as f32);
        for k in 0..3 {
            let across = low.neighbours[t][k];
            if across != NO_NEIGHBOUR && self.facing[across as usize] == self.facing[t] {
                continue;
            }
            let vertices = [low.triangles[t][k], low.triangles[t][(k + 1) % 3]];
            if let Some(crossing) = crossing(vertices.map(|v| self.pixels[v as usize]), centre, horizontal) {
                let along = if horizontal { centre.x } else { centre.y };
                let reach = (crossing - along) * sign;
                if (0.0..=1.0).contains(&reach) {
                    let (near, far) = (near as u32, far as u32);
                    self.blends.push(Blend { near, far, reach, vertices, horizontal, sign });
                    return;
                }
            }
        }
    }

    fn blend(&mut self) {
        for y in self.rect.rows() {
            let row = y * self.size;
            let span = row + self.rect.x0..row + self.rect.x1.max(self.rect.x0);
            self.image[span.clone()].copy_from_slice(&self.base[span]);
        }
        for blend in &self.blends {
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

/// Where an edge crosses the row (or column) through `centre`, if that is its minor direction.
#[inline]
fn crossing([a, b]: [Vec2; 2], centre: Vec2, horizontal: bool) -> Option<f32> {
    let swap = |v: Vec2| if horizontal { v } else { Vec2::new(v.y, v.x) };
    let (a, b, c) = (swap(a), swap(b), swap(centre));
    let (across, along) = (b.y - a.y, b.x - a.x);
    if (a.y - c.y) * (b.y - c.y) > 0.0 || across == 0.0 || along.abs() > across.abs() {
        return None;
    }
    Some(a.x + along * ((c.y - a.y) / across))
}
