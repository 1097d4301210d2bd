//! Views to fit and views to score by.

use rayon::prelude::*;

use super::forward::FrameBuffers;
use super::image_loss::squared_error;
use super::{LowPoly, Solver, TextureFit, optimise_texture, solve_texture};
use crate::Cancellation;
use crate::render::{Image, Rect, View};

/// One view in this many is held out to score by.
const HELD_OUT: usize = 6;

pub(super) struct TrainValidationSplit<'a> {
    pub(super) fitted: Vec<&'a View>,
    /// Pixels that the source covers.
    pub(super) fitted_rects: Vec<Rect>,
    held_out: Vec<&'a View>,
    held_out_rects: Vec<Rect>,
    /// The texture is fitted to one fitted view in so many.
    texture_stride: usize,
    cancellation: &'a Cancellation,
}

impl<'a> TrainValidationSplit<'a> {
    pub(super) fn new(views: &'a [View], cancellation: &'a Cancellation) -> Self {
        let pick = |held: bool| -> Vec<&View> {
            let chosen = views.iter().enumerate().filter(|(i, _)| (i % HELD_OUT == HELD_OUT / 2) == held);
            chosen.map(|(_, v)| v).collect()
        };
        let (fitted, held_out) = (pick(false), pick(true));
        let rects = |views: &[&View]| views.iter().map(|v| covered_rect(&v.image)).collect();
        let (fitted_rects, held_out_rects) = (rects(&fitted), rects(&held_out));
        Self { fitted, fitted_rects, held_out, held_out_rects, texture_stride: 1, cancellation }
    }

    /// Fits the texture to at most `most` of the views, spread over them.
    pub(super) fn fitting_texture_to(self, most: usize) -> Self {
        Self { texture_stride: self.fitted.len().div_ceil(most).max(1), ..self }
    }

    /// Side of the pictures.
    pub(super) fn size(&self) -> usize {
        self.fitted.first().map_or(0, |view| view.image.size)
    }

    /// Fits the texture, if it is to be.
    pub(super) fn fit(&self, low: &mut LowPoly, fit: Option<&TextureFit>) {
        let Some(&TextureFit { smoothness, trust, solver }) = fit else { return };
        let views: Vec<&View> = self.fitted.iter().copied().step_by(self.texture_stride).collect();
        let rects: Vec<Rect> = self.fitted_rects.iter().copied().step_by(self.texture_stride).collect();
        let (views, rects) = (&views, &rects);
        match solver {
            Solver::LeastSquares => {
                solve_texture(low, views, rects, smoothness, trust, self.cancellation);
            }
            Solver::Adam(descent) => {
                optimise_texture(low, views, rects, smoothness, &descent, self.cancellation);
            }
        }
    }

    /// Mean PSNR over the views held out, on white, in dB; over some of them if cancelled.
    pub(super) fn score(&self, low: &LowPoly) -> f32 {
        let errors: Vec<f64> = self
            .held_out
            .par_iter()
            .zip(&self.held_out_rects)
            .filter(|_| !self.cancellation.is_cancelled())
            .map_init(
                || FrameBuffers::new(self.held_out[0].image.size),
                |frame, (view, rect)| {
                    frame.render(low, &view.camera, view.pose, *rect);
                    squared_error(frame, &view.image, 1.0) / (3 * frame.size * frame.size) as f64
                },
            )
            .collect();
        let decibels = |e: &f64| -10.0 * libm::log10(e.max(1e-10));
        (errors.iter().map(decibels).sum::<f64>() / errors.len().max(1) as f64) as f32
    }
}

/// The rectangle of pixels that the source touches.
fn covered_rect(image: &Image) -> Rect {
    let n = image.size;
    let mut rect = Rect { x0: n, y0: n, x1: 0, y1: 0 };
    for y in 0..n {
        let row = &image.pixels[y * n..(y + 1) * n];
        if let (Some(first), Some(last)) = (row.iter().position(|p| p[3] > 0), row.iter().rposition(|p| p[3] > 0)) {
            rect = Rect { x0: rect.x0.min(first), x1: rect.x1.max(last + 1), y0: rect.y0.min(y), y1: y + 1 };
        }
    }
    rect
}
