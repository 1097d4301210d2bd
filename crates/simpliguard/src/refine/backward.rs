//! Backward pass, mirroring [`super::forward`]: from the gradient at the pixels to the vertices, or to the texture.

use glam::{Mat4, Vec2, Vec3, Vec4, Vec4Swizzles};

use super::LowPoly;
use super::forward::{Blend, FrameBuffers, Lookup};
use crate::render::raster::{pixel_to_ndc, to_pixels};
use crate::render::{EMPTY_PIXEL, Image};

/// Gradients of one view, reused from step to step.
#[derive(Default)]
pub(super) struct Gradients {
    /// At the pixels before antialiasing.
    base: Vec<Vec4>,
    /// In clip space: x, y, w of each vertex (depth carries none).
    clip: Vec<Vec3>,
    /// In world space, in the pose of the view.
    pub(super) posed: Vec<Vec3>,
    /// In world space, in the rest pose.
    pub(super) positions: Vec<Vec3>,
    /// At the texels; their fourth slot has none.
    pub(super) texels: Vec<Vec4>,
}

impl Gradients {
    /// Carries `image`, the gradient at the antialiased pixels within `frame.rect`, to the vertices.
    pub(super) fn run(
        &mut self,
        low: &LowPoly,
        view_projection: &Mat4,
        pose: Option<usize>,
        frame: &FrameBuffers,
        image: &[Vec4],
    ) {
        self.clip.clear();
        self.clip.resize(low.positions.len(), Vec3::ZERO);
        self.unblend(frame, image);
        self.unshade(low, frame);
        let transposed = view_projection.transpose();
        self.posed.clear();
        let to_world = |g: &Vec3| (transposed * Vec4::new(g.x, g.y, 0.0, g.z)).xyz();
        self.posed.extend(self.clip.iter().map(to_world));
        self.positions.clone_from(&self.posed);
        if let Some(motions) = low.motions.of(pose) {
            for (gradient, motion) in self.positions.iter_mut().zip(motions) {
                *gradient = motion.matrix3.transpose() * *gradient;
            }
        }
    }

    /// Carries `image` to the texels, from pixels that lie wholly on the level and, by `target`, on the source: others hold
    /// background.
    pub(super) fn run_texture(&mut self, low: &LowPoly, frame: &FrameBuffers, target: &Image, image: &[Vec4]) {
        self.texels.clear();
        self.texels.resize(low.texels.len(), Vec4::ZERO);
        self.take(frame, image);
        for blend in &frame.blends {
            self.base[blend.near as usize] = Vec4::ZERO;
            self.base[blend.far as usize] = Vec4::ZERO;
        }
        for y in frame.rect.rows() {
            let ndc_y = pixel_to_ndc(y, frame.size);
            for x in frame.rect.columns() {
                let i = y * frame.size + x;
                let id = frame.raster.ids[i];
                if id == EMPTY_PIXEL || target.pixels[i][3] != 255 {
                    continue;
                }
                let lookup = Lookup::new(frame.uv_at(low, id as usize, x, ndc_y).0, low.size);
                let (k, gradient) = (lookup.texel, self.base[i].with_w(0.0));
                for (k, weight) in [k, k + 1, k + low.size, k + low.size + 1].into_iter().zip(lookup.weights()) {
                    self.texels[k] += gradient * weight;
                }
            }
        }
    }

    /// Begins with the gradient at the antialiased pixels.
    fn take(&mut self, frame: &FrameBuffers, image: &[Vec4]) {
        self.base.resize(image.len(), Vec4::ZERO);
        for y in frame.rect.rows() {
            let row = y * frame.size;
            let span = row + frame.rect.x0..row + frame.rect.x1.max(frame.rect.x0);
            self.base[span.clone()].copy_from_slice(&image[span]);
        }
    }

    fn unblend(&mut self, frame: &FrameBuffers, image: &[Vec4]) {
        self.take(frame, image);
        for blend in &frame.blends {
            let (near, far) = (blend.near as usize, blend.far as usize);
            let difference = frame.base[near] - frame.base[far];
            let (weight, gradient) =
                if blend.reach < 0.5 { (0.5 - blend.reach, image[near]) } else { (blend.reach - 0.5, image[far]) };
            let share = gradient * weight;
            if blend.reach < 0.5 {
                self.base[near] -= share;
                self.base[far] += share;
            } else {
                self.base[near] += share;
                self.base[far] -= share;
            }
            self.move_edge(frame, blend, gradient.dot(difference) * blend.sign);
        }
    }

    /// Carries the gradient of a crossing's coordinate to the two ends of its edge.
    fn move_edge(&mut self, frame: &FrameBuffers, blend: &Blend, gradient: f32) {
        let swap = |v: Vec2| if blend.horizontal { v } else { Vec2::new(v.y, v.x) };
        let clip = blend.vertices.map(|v| frame.clip[v as usize]);
        let [a, b] = clip.map(|c| swap(to_pixels(c, frame.size).truncate()));
        let centre =
            swap(Vec2::new((blend.near as usize % frame.size) as f32, (blend.near as usize / frame.size) as f32));
        // crossing = a.x + (b.x - a.x) * t with t = (centre.y - a.y) / (b.y - a.y)
        let t = (centre.y - a.y) / (b.y - a.y);
        let slope = (b.x - a.x) / (b.y - a.y);
        let ends = [Vec2::new(1.0 - t, slope * (t - 1.0)), Vec2::new(t, -slope * t)];
        let half = 0.5 * frame.size as f32;
        for ((&v, clip), end) in blend.vertices.iter().zip(clip).zip(ends) {
            let scaled = swap(end * gradient) * (half / clip.w);
            let w = -(scaled.x * clip.x + scaled.y * clip.y) / clip.w;
            self.clip[v as usize] += scaled.extend(w);
        }
    }

    fn unshade(&mut self, low: &LowPoly, frame: &FrameBuffers) {
        for y in frame.rect.rows() {
            let ndc_y = pixel_to_ndc(y, frame.size);
            let mut last = EMPTY_PIXEL;
            let mut sums = [Vec3::ZERO; 3];
            for x in frame.rect.columns() {
                let i = y * frame.size + x;
                let id = frame.raster.ids[i];
                if id != last {
                    self.flush(low, last, &mut sums);
                    last = id;
                }
                if id != EMPTY_PIXEL {
                    self.unshade_pixel(low, frame, id as usize, i, (x, ndc_y), &mut sums);
                }
            }
            self.flush(low, last, &mut sums);
        }
    }

    #[inline]
    fn unshade_pixel(
        &self,
        low: &LowPoly,
        frame: &FrameBuffers,
        t: usize,
        pixel: usize,
        (x, ndc_y): (usize, f32),
        sums: &mut [Vec3; 3],
    ) {
        let gradient = self.base[pixel];
        let (uv, b, inverse) = frame.uv_at(low, t, x, ndc_y);
        let lookup = Lookup::new(uv, low.size);
        let k = lookup.texel;
        let [t00, t10, t01, t11] = [k, k + 1, k + low.size, k + low.size + 1].map(|k| low.texels[k]);
        let along_u = gradient.dot((t10 - t00) * (1.0 - lookup.fy) + (t11 - t01) * lookup.fy);
        let along_v = gradient.dot((t01 - t00) * (1.0 - lookup.fx) + (t11 - t10) * lookup.fx);
        let by_b = Vec3::from(low.uvs[t].map(|uv| along_u * uv.x + along_v * uv.y));
        // b = a / sum(a)
        let by_a = (by_b - Vec3::splat(by_b.dot(b))) * inverse;
        // a_0 = p_1 x p_2 and so on, with p_i = (x_i, y_i) - w_i * pixel
        let ndc = Vec2::new(pixel_to_ndc(x, frame.size), ndc_y);
        let [p0, p1, p2] = low.triangles[t].map(|v| {
            let c = frame.clip[v as usize];
            c.xy() - ndc * c.w
        });
        let by_p = [
            Vec2::new(by_a.z * p1.y - by_a.y * p2.y, by_a.y * p2.x - by_a.z * p1.x),
            Vec2::new(by_a.x * p2.y - by_a.z * p0.y, by_a.z * p0.x - by_a.x * p2.x),
            Vec2::new(by_a.y * p0.y - by_a.x * p1.y, by_a.x * p1.x - by_a.y * p0.x),
        ];
        for (sum, g) in sums.iter_mut().zip(by_p) {
            *sum += g.extend(-ndc.dot(g));
        }
    }

    fn flush(&mut self, low: &LowPoly, id: u32, sums: &mut [Vec3; 3]) {
        if id != EMPTY_PIXEL {
            for (&v, sum) in low.triangles[id as usize].iter().zip(sums) {
                self.clip[v as usize] += std::mem::take(sum);
            }
        }
    }
}
