//! Image loss: squared error and squared error of the image gradient (`L_img`, paper 3.4).
//!
//! With forward differences both are quadratic in the residual, so the gradient is a five-point stencil on it:
//! `dL/dr = 2/n (I - lambda Laplace) (r - t)`.

use glam::{Vec4, Vec4Swizzles};

use super::forward::FrameBuffers;
use crate::render::Image;

/// Weight of the squared coverage error against those of the three colours over the background.
const COVERAGE_WEIGHT: f32 = 1.0;

/// Scratch for the residual, and the gradient at the pixels.
#[derive(Default)]
pub(super) struct Loss {
    residual: Vec<Vec4>,
    /// At the antialiased pixels of the frame's rectangle.
    pub(super) gradient: Vec<Vec4>,
}

impl Loss {
    /// Loss of a frame against the source over a background of one encoded grey, per pixel of the frame.
    pub(super) fn run(&mut self, frame: &FrameBuffers, target: &Image, background: f32, lambda: f32) -> f64 {
        let size = frame.size;
        self.residual.resize(size * size, Vec4::ZERO);
        self.gradient.resize(size * size, Vec4::ZERO);
        for y in frame.rect.rows() {
            for i in y * size + frame.rect.x0..y * size + frame.rect.x1.max(frame.rect.x0) {
                let d = frame.image[i] - target.at(i);
                self.residual[i] = (d.xyz() - background * d.w).extend(COVERAGE_WEIGHT * d.w);
            }
        }
        let scale = 2.0 / (size * size) as f32;
        let mut loss = 0.0;
        let rect = frame.rect;
        for y in rect.rows() {
            let mut row = 0.0;
            for x in rect.columns() {
                let i = y * size + x;
                let e = self.residual[i];
                let mut laplace = Vec4::ZERO;
                let mut slope = 0.0;
                for (inside, j, forward) in [
                    (x + 1 < rect.x1, i + 1, true),
                    (y + 1 < rect.y1, i + size, true),
                    (x > rect.x0, i.wrapping_sub(1), false),
                    (y > rect.y0, i.wrapping_sub(size), false),
                ] {
                    if inside {
                        let d = self.residual[j] - e;
                        laplace += d;
                        slope += if forward { d.length_squared() } else { 0.0 };
                    }
                }
                row += e.length_squared() + lambda * slope;
                let g = (e - laplace * lambda) * scale;
                let coverage = COVERAGE_WEIGHT * g.w - background * (g.x + g.y + g.z);
                self.gradient[i] = g.xyz().extend(coverage);
            }
            loss += f64::from(row);
        }
        loss / (size * size) as f64
    }
}

/// Sum of squared colour errors over a background, and the number of values it is over.
pub(super) fn squared_error(frame: &FrameBuffers, target: &Image, background: f32) -> f64 {
    let mut sum = 0.0;
    for y in frame.rect.rows() {
        let row = y * frame.size;
        for i in row + frame.rect.x0..row + frame.rect.x1.max(frame.rect.x0) {
            let d = frame.image[i] - target.at(i);
            sum += f64::from((d.xyz() - background * d.w).length_squared());
        }
    }
    sum
}
