//! Views to fit (training) and views to score by (validation).

use rayon::prelude::*;

use super::covered_views::CoveredViews;
use super::forward::FrameBuffers;
use super::losses::{squared_error, squared_error_of_means};
use super::low_poly::LowPoly;
use super::params::{Solver, TextureFit};
use super::texture_adam::optimise_texture;
use super::texture_least_squares::solve_texture;
use crate::Cancellation;
use crate::render::{View, decibels};

/// One view in this many is held out for validation.
const HELD_OUT: usize = 6;
/// Weight of a pixel of a view without antialiasing: four of them lie in one of an antialiased view.
const ALIASED_PIXEL_WEIGHT: f32 = 0.25;

/// Views of one source, split into those to fit and those to score by.
pub(super) struct TrainValidationSplit<'a> {
    pub(super) train: CoveredViews<'a>,
    validation: CoveredViews<'a>,
    /// The texture is fitted to one training view in this many.
    texture_stride: usize,
    /// The views are not antialiased.
    aliased: bool,
    cancellation: &'a Cancellation,
}

impl<'a> TrainValidationSplit<'a> {
    pub(super) fn new(views: &'a [View], cancellation: &'a Cancellation) -> Self {
        let pick = |held_out: bool| {
            let chosen = views.iter().enumerate().filter(|(i, _)| (i % HELD_OUT == HELD_OUT / 2) == held_out);
            CoveredViews::new(chosen.map(|(_, view)| view).collect())
        };
        Self { train: pick(false), validation: pick(true), texture_stride: 1, aliased: false, cancellation }
    }

    /// Views without antialiasing: each pixel is one point, in the views as in the level's image, and they are scored by
    /// the means of four.
    pub(super) fn aliased(views: &'a [View], cancellation: &'a Cancellation) -> Self {
        let split = Self::new(views, cancellation);
        let train = CoveredViews { pixel_weight: ALIASED_PIXEL_WEIGHT, ..split.train };
        Self { aliased: true, train, ..split }
    }

    /// Fits the texture to at most `most` of the training views, spread over them.
    pub(super) fn fitting_texture_to(self, most: usize) -> Self {
        Self { texture_stride: self.train.len().div_ceil(most).max(1), ..self }
    }

    /// Fits the texture of `low` to the training views, unless `fit` is `None`.
    pub(super) fn fit_texture(&self, low: &mut LowPoly, fit: Option<&TextureFit>) {
        let Some(TextureFit { smoothness, trust, solver }) = fit else { return };
        let views = self.train.every(self.texture_stride);
        match solver {
            Solver::LeastSquares => solve_texture(low, &views, *smoothness, *trust, self.cancellation),
            Solver::Adam(adam) => optimise_texture(low, &views, *smoothness, adam, self.cancellation),
        }
    }

    /// Mean PSNR over the validation views, in dB; over some of them if cancelled. The background is white and black by
    /// halves: on one alone, the outline of a model of that colour would not count.
    pub(super) fn score(&self, low: &LowPoly) -> f32 {
        let CoveredViews { views, rects, .. } = &self.validation;
        let errors: Vec<f64> = views
            .par_iter()
            .zip(rects)
            .filter(|_| !self.cancellation.is_cancelled())
            .map_init(
                || FrameBuffers::new(self.validation.size()),
                |frame, (view, rect)| {
                    let pixels = 3 * frame.size * frame.size;
                    if self.aliased {
                        frame.render_aliased(low, &view.camera, view.pose, *rect);
                        let error = |background| squared_error_of_means(frame, &view.image, background);
                        return 2.0 * (error(1.0) + error(0.0)) / pixels as f64;
                    }
                    frame.render(low, &view.camera, view.pose, *rect);
                    let error = |background| squared_error(frame, &view.image, background);
                    0.5 * (error(1.0) + error(0.0)) / pixels as f64
                },
            )
            .collect();
        (errors.iter().copied().map(decibels).sum::<f64>() / errors.len().max(1) as f64) as f32
    }
}
