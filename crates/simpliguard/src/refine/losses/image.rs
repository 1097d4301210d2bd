//! Image loss: squared error and squared error of the image gradient (`L_img`, paper 3.4).
//!
//! With forward differences both are quadratic in the residual, so the gradient is a five-point stencil on it:
//! `dL/dr = 2/n (I - lambda Laplace) (r - t)`.

use glam::{Vec4, Vec4Swizzles};

use crate::refine::forward::FrameBuffers;
use crate::render::{Image, Rect, difference_over};

/// Weight of the squared coverage error against the squared errors of the three colours over the background.
const COVERAGE_WEIGHT: f32 = 1.0;

/// Buffers of the image loss of one view, reused from step to step.
#[derive(Default)]
pub(in crate::refine) struct ImageLoss {
    residual: Vec<Vec4>,
    /// At the antialiased pixels of the frame's rectangle.
    pub(in crate::refine) gradient: Vec<Vec4>,
}

impl ImageLoss {
    /// Compares a frame with `target` over a background of one encoded grey, 0 to 1. `lambda` is the weight of the image
    /// gradient. Replaces the gradient and returns the loss, per pixel of the frame.
    pub(in crate::refine) fn run(&mut self, frame: &FrameBuffers, target: &Image, background: f32, lambda: f32) -> f64 {
        let FrameBuffers { size, rect, .. } = *frame;
        self.find_residual(frame, target, background);
        self.gradient.resize(size * size, Vec4::ZERO);
        let scale = 2.0 / (size * size) as f32;
        let mut loss = 0.0;
        for y in rect.rows() {
            let mut row = 0.0;
            for x in rect.columns() {
                let i = y * size + x;
                let e = self.residual[i];
                let (laplace, slope) = self.differences(rect, size, x, y);
                row += e.length_squared() + lambda * slope;
                let g = (e - laplace * lambda) * scale;
                let coverage = COVERAGE_WEIGHT * g.w - background * (g.x + g.y + g.z);
                self.gradient[i] = g.xyz().extend(coverage);
            }
            loss += f64::from(row);
        }
        loss / (size * size) as f64
    }

    fn find_residual(&mut self, frame: &FrameBuffers, target: &Image, background: f32) {
        self.residual.resize(frame.size * frame.size, Vec4::ZERO);
        for y in frame.rect.rows() {
            for i in frame.span(y) {
                let d = frame.image[i] - target.at(i);
                self.residual[i] = difference_over(d, background).extend(COVERAGE_WEIGHT * d.w);
            }
        }
    }

    /// Laplacian of the residual at a pixel, and the sum of its squared forward differences there.
    #[inline]
    fn differences(&self, rect: Rect, size: usize, x: usize, y: usize) -> (Vec4, f32) {
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
        (laplace, slope)
    }
}

/// Sum of the squared colour errors over a background of one encoded grey, 0 to 1, in the frame's rectangle.
pub(in crate::refine) fn squared_error(frame: &FrameBuffers, target: &Image, background: f32) -> f64 {
    let mut sum = 0.0;
    for y in frame.rect.rows() {
        for i in frame.span(y) {
            let d = frame.image[i] - target.at(i);
            sum += f64::from(difference_over(d, background).length_squared());
        }
    }
    sum
}

/// As [`squared_error`], of images of half the size whose pixels are means of four. They are what a viewer sees of an image
/// without antialiasing.
pub(in crate::refine) fn squared_error_of_means(frame: &FrameBuffers, target: &Image, background: f32) -> f64 {
    let rect = frame.rect.aligned(2);
    // Beyond the frame's rectangle there is nothing, and its buffer holds earlier views.
    let difference = |x: usize, y: usize| {
        let (i, is_drawn) = (y * frame.size + x, frame.rect.contains(x, y));
        if is_drawn { frame.base[i] - target.at(i) } else { Vec4::ZERO }
    };
    let mut sum = 0.0;
    for y in rect.rows().step_by(2) {
        for x in rect.columns().step_by(2) {
            let four = difference(x, y) + difference(x + 1, y) + difference(x, y + 1) + difference(x + 1, y + 1);
            sum += f64::from(difference_over(four * 0.25, background).length_squared());
        }
    }
    sum
}
