//! Views to fit (training) and views to score by (validation).

use super::backend::{Backend, LevelRenderer};
use super::covered_views::CoveredViews;
use super::low_poly::LowPoly;
use super::params::{Solver, TextureFit};
use super::texture_adam::optimise_texture;
use super::texture_least_squares::{CoarseSolution, LeastSquares};
use crate::Cancellation;
use crate::render::{View, decibels};

/// One view in this many is held out for validation.
const HELD_OUT: usize = 6;

/// Views of one source, split into those to fit and those to score by, with what renders a level for them.
pub(super) struct TrainValidationSplit<'a, E> {
    pub(super) train: CoveredViews<'a>,
    pub(super) train_renderer: Box<dyn LevelRenderer<Error = E> + 'a>,
    validation_renderer: Box<dyn LevelRenderer<Error = E> + 'a>,
    /// The texture is fitted to one training view in this many.
    texture_stride: usize,
    backend: &'a dyn Backend<Error = E>,
    cancellation: &'a Cancellation,
}

/// The views to fit, and those to score by.
fn split(views: &[View]) -> [Vec<&View>; 2] {
    [false, true].map(|is_held_out| {
        let chosen = views.iter().enumerate().filter(|(i, _)| (i % HELD_OUT == HELD_OUT / 2) == is_held_out);
        chosen.map(|(_, view)| view).collect()
    })
}

impl<'a, E> TrainValidationSplit<'a, E> {
    /// Antialiased views of a source that `low` is to look like.
    pub(super) fn new(
        views: &'a [View],
        low: &LowPoly,
        backend: &'a dyn Backend<Error = E>,
        cancellation: &'a Cancellation,
    ) -> Result<Self, E> {
        Self::of(split(views).map(CoveredViews::new), low, backend, cancellation)
    }

    /// The same of views without antialiasing.
    pub(super) fn aliased(
        views: &'a [View],
        low: &LowPoly,
        backend: &'a dyn Backend<Error = E>,
        cancellation: &'a Cancellation,
    ) -> Result<Self, E> {
        Self::of(split(views).map(CoveredViews::aliased), low, backend, cancellation)
    }

    fn of(
        [train, validation]: [CoveredViews<'a>; 2],
        low: &LowPoly,
        backend: &'a dyn Backend<Error = E>,
        cancellation: &'a Cancellation,
    ) -> Result<Self, E> {
        let train_renderer = backend.open(low, train.clone(), cancellation)?;
        let validation_renderer = backend.open(low, validation, cancellation)?;
        Ok(Self { train, train_renderer, validation_renderer, texture_stride: 1, backend, cancellation })
    }

    /// Fits the texture to at most `most` of the training views, spread over them.
    pub(super) fn fitting_texture_to(self, most: usize) -> Self {
        Self { texture_stride: self.train.len().div_ceil(most).max(1), ..self }
    }

    /// Fits the texture of `low` to the training views, unless `fit` is `None`.
    pub(super) fn fit_texture(&mut self, low: &mut LowPoly, fit: Option<&TextureFit>) -> Result<(), E> {
        let Some(&TextureFit { smoothness, trust, solver }) = fit else { return Ok(()) };
        let terms = LeastSquares::new(self.texture_stride, smoothness);
        match (solver, trust) {
            (Solver::LeastSquares, None) => self.train_renderer.solve_texture(low, terms),
            (Solver::LeastSquares, Some(scale)) => self.solve_nested(low, terms, scale),
            (Solver::Adam(adam), _) => {
                let views = self.train.every(self.texture_stride);
                optimise_texture(low, &views, smoothness, &adam, self.cancellation);
                Ok(())
            }
        }
    }

    /// Solves for the texture in two steps. A pixel counts by how well it agrees with a first, smoother solution of half the
    /// size (one step of iteratively reweighted least squares, with Cauchy weights of this scale). Along inner outlines of the
    /// level a view may show another surface of the source than the level does; so weighted, it leaves no specks. The solution
    /// at full size starts from the change of the first one (nested iteration).
    fn solve_nested(&mut self, low: &mut LowPoly, terms: LeastSquares<'_>, scale: f32) -> Result<(), E> {
        let mut half = low.halved();
        let initial = half.texture.texels.clone();
        let mut half_renderer = self.backend.open(&half, self.train.clone(), self.cancellation)?;
        half_renderer.solve_texture(&mut half, terms.halved())?;
        let coarse = CoarseSolution::new(half.texture.texels, &initial, half.texture.size, scale);
        self.train_renderer.solve_texture(low, terms.nested(&coarse))
    }

    /// Mean PSNR over the validation views, in dB; over some of them if cancelled. The background is white and black by
    /// halves: on one alone, the outline of a model of that colour would not count.
    pub(super) fn score(&mut self, low: &LowPoly) -> Result<f32, E> {
        let errors = self.validation_renderer.errors(low)?;
        Ok((errors.iter().copied().map(decibels).sum::<f64>() / errors.len().max(1) as f64) as f32)
    }
}
