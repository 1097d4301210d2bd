//! Backward pass, mirroring [`super::forward`]: from the gradient at the pixels to the vertices, or to the texture.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};

use super::backend::ViewGradient;
use super::forward::FrameBuffers;
use super::lookup::Lookup;
use super::low_poly::LowPoly;
use super::silhouettes::Blend;
use crate::render::raster::{pixel_to_ndc, to_pixels};
use crate::render::{EMPTY_PIXEL, Image};

/// Gradients of one view on the way to its vertices or texels, reused from step to step.
#[derive(Default)]
pub(super) struct Gradients {
    /// At the pixels before antialiasing.
    base: Vec<Vec4>,
    /// In clip space: x, y, w of each vertex (depth carries none).
    clip: Vec<Vec3>,
    /// At the texels; zero in their fourth slot.
    pub(super) texels: Vec<Vec4>,
}

impl Gradients {
    /// Carries `image`, the gradient at the antialiased pixels within `frame.rect`, to the vertices.
    pub(super) fn backward_to_vertices(
        &mut self,
        low: &LowPoly,
        frame: &FrameBuffers,
        image: &[Vec4],
        ViewGradient { posed, positions, .. }: &mut ViewGradient,
    ) {
        self.clip.clear();
        self.clip.resize(low.positions.len(), Vec3::ZERO);
        self.backward_blends(frame, image);
        self.backward_shading(low, frame);
        let transposed = frame.view_projection.transpose();
        posed.clear();
        let to_world = |g: &Vec3| (transposed * Vec4::new(g.x, g.y, 0.0, g.z)).xyz();
        posed.extend(self.clip.iter().map(to_world));
        positions.clone_from(posed);
        if let Some(motions) = low.motions.of(frame.pose) {
            for (gradient, motion) in positions.iter_mut().zip(motions) {
                *gradient = motion.matrix3.transpose() * *gradient;
            }
        }
    }

    /// Carries `image` to the texels, from pixels that lie wholly on the level and, by `target`, on the source: others hold
    /// background.
    pub(super) fn backward_to_texels(&mut self, low: &LowPoly, frame: &FrameBuffers, target: &Image, image: &[Vec4]) {
        let size = low.texture.size;
        self.texels.clear();
        self.texels.resize(low.texture.texels.len(), Vec4::ZERO);
        self.load(frame, image);
        for blend in &frame.silhouettes.blends {
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
                let ndc = Vec2::new(pixel_to_ndc(x, frame.size), ndc_y);
                let lookup = Lookup::new(frame.uv_at(low, id as usize, ndc).0, size);
                let gradient = self.base[i].with_w(0.0);
                for (k, weight) in lookup.texels(size).into_iter().zip(lookup.weights()) {
                    self.texels[k] += gradient * weight;
                }
            }
        }
    }

    /// Begins with the gradient at the antialiased pixels.
    fn load(&mut self, frame: &FrameBuffers, image: &[Vec4]) {
        self.base.resize(image.len(), Vec4::ZERO);
        for y in frame.rect.rows() {
            let span = frame.span(y);
            self.base[span.clone()].copy_from_slice(&image[span]);
        }
    }

    /// Carries `image` to the pixels before antialiasing, and to the silhouette edges.
    fn backward_blends(&mut self, frame: &FrameBuffers, image: &[Vec4]) {
        self.load(frame, image);
        for blend in &frame.silhouettes.blends {
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
            self.backward_edge(frame, blend, gradient.dot(difference) * blend.sign);
        }
    }

    /// Carries the gradient of a crossing's coordinate to the two ends of its edge.
    fn backward_edge(&mut self, frame: &FrameBuffers, blend: &Blend, gradient: f32) {
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

    /// Carries the gradient at the pixels before antialiasing to the vertices that the texture coordinates depend on.
    fn backward_shading(&mut self, low: &LowPoly, frame: &FrameBuffers) {
        for y in frame.rect.rows() {
            let ndc_y = pixel_to_ndc(y, frame.size);
            // Summed over a run of pixels of one triangle.
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
                    let ndc = Vec2::new(pixel_to_ndc(x, frame.size), ndc_y);
                    let gradients = corner_gradients(low, frame, id as usize, ndc, self.base[i]);
                    sums.iter_mut().zip(gradients).for_each(|(sum, g)| *sum += g);
                }
            }
            self.flush(low, last, &mut sums);
        }
    }

    /// Adds the sums of a run of pixels to the vertices of triangle `id`, and clears them.
    fn flush(&mut self, low: &LowPoly, id: u32, sums: &mut [Vec3; 3]) {
        if id != EMPTY_PIXEL {
            for (&v, sum) in low.triangles[id as usize].iter().zip(sums) {
                self.clip[v as usize] += std::mem::take(sum);
            }
        }
    }
}

/// Gradient at the corners of triangle `t` in clip space (x, y, w), from the gradient at one of its pixels, which lies at
/// `ndc`.
#[inline]
fn corner_gradients(low: &LowPoly, frame: &FrameBuffers, t: usize, ndc: Vec2, gradient: Vec4) -> [Vec3; 3] {
    let (uv, b, inverse) = frame.uv_at(low, t, ndc);
    let lookup = Lookup::new(uv, low.texture.size);
    let [t00, t10, t01, t11] = lookup.texels(low.texture.size).map(|k| low.texture.texels[k]);
    let along_u = gradient.dot((t10 - t00) * (1.0 - lookup.fy) + (t11 - t01) * lookup.fy);
    let along_v = gradient.dot((t01 - t00) * (1.0 - lookup.fx) + (t11 - t10) * lookup.fx);
    let by_b = Vec3::from(low.uvs[t].map(|uv| along_u * uv.x + along_v * uv.y));
    // b = a / sum(a)
    let by_a = (by_b - Vec3::splat(by_b.dot(b))) * inverse;
    // a_0 = p_1 x p_2 and so on, with p_i = (x_i, y_i) - w_i * pixel
    let [p0, p1, p2] = low.triangles[t].map(|v| {
        let c = frame.clip[v as usize];
        c.xy() - ndc * c.w
    });
    let by_p = [
        Vec2::new(by_a.z * p1.y - by_a.y * p2.y, by_a.y * p2.x - by_a.z * p1.x),
        Vec2::new(by_a.x * p2.y - by_a.z * p0.y, by_a.z * p0.x - by_a.x * p2.x),
        Vec2::new(by_a.y * p0.y - by_a.x * p1.y, by_a.x * p1.x - by_a.y * p0.x),
    ];
    by_p.map(|g| g.extend(-ndc.dot(g)))
}
