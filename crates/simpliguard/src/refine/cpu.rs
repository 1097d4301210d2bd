//! Renders levels on the threads of the caller.

use std::convert::Infallible;

use rayon::prelude::*;

use super::backend::{BATCH, Backend, Drawing, LevelRenderer, LossTerms, ViewGradient};
use super::backward::Gradients;
use super::covered_views::CoveredViews;
use super::forward::FrameBuffers;
use super::losses::{ImageLoss, squared_error, squared_error_of_means};
use super::low_poly::LowPoly;
use super::texture_least_squares::{LeastSquares, solve_texture};
use crate::Cancellation;
use crate::render::{Pool, Rect, View};

/// The threads of the caller. They give the same bytes on every machine, and never fail.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cpu;

impl Backend for Cpu {
    type Error = Infallible;

    fn name(&self) -> &str {
        "CPU"
    }

    fn can_hold(&self, _: usize, _: usize) -> bool {
        true
    }

    fn open<'a>(
        &'a self,
        _: &LowPoly,
        views: CoveredViews<'a>,
        cancellation: &'a Cancellation,
    ) -> Result<Box<dyn LevelRenderer<Error = Infallible> + 'a>, Infallible> {
        Ok(Box::new(CpuRenderer { views, cancellation, slots: Vec::new(), frames: Pool::new() }))
    }
}

/// Renders a level for some views.
struct CpuRenderer<'a> {
    views: CoveredViews<'a>,
    cancellation: &'a Cancellation,
    /// Made with the first step.
    slots: Vec<BatchSlot>,
    /// Buffers of the views that are scored.
    frames: Pool<FrameBuffers>,
}

/// Everything that one view of a batch needs, reused from step to step.
pub(super) struct BatchSlot {
    pub(super) frame: FrameBuffers,
    pub(super) loss: ImageLoss,
    pub(super) gradients: Gradients,
}

impl BatchSlot {
    /// For views of `size` x `size` pixels.
    pub(super) fn new(size: usize) -> Self {
        Self { frame: FrameBuffers::new(size), loss: ImageLoss::default(), gradients: Gradients::default() }
    }
}

impl LevelRenderer for CpuRenderer<'_> {
    type Error = Infallible;

    fn differentiate(
        &mut self,
        low: &LowPoly,
        views: [usize; BATCH],
        LossTerms { background, gradient_weight }: LossTerms,
        gradients: &mut [ViewGradient; BATCH],
    ) -> Result<(), Infallible> {
        let Self { views: all, slots, .. } = self;
        slots.resize_with(BATCH, || BatchSlot::new(all.size()));
        let slots = slots.par_iter_mut().zip(&views).zip(gradients);
        slots.with_max_len(1).for_each(|((BatchSlot { frame, loss, gradients }, &view), out)| {
            let (view, rect) = (all.views[view], all.rects[view]);
            frame.render(low, &view.camera, view.pose, rect);
            out.loss = loss.run(frame, &view.image, background, gradient_weight);
            gradients.backward_to_vertices(low, frame, &loss.gradient, out);
        });
        Ok(())
    }

    fn errors(&mut self, low: &LowPoly) -> Result<Vec<f64>, Infallible> {
        let CoveredViews { views, rects, aliased, .. } = &self.views;
        let error = |frame: &mut FrameBuffers, view: &View, rect: Rect| {
            let pixels = 3 * frame.size * frame.size;
            if *aliased {
                frame.render_aliased(low, &view.camera, view.pose, rect);
                let error = |background| squared_error_of_means(frame, &view.image, background);
                return 2.0 * (error(1.0) + error(0.0)) / pixels as f64;
            }
            frame.render(low, &view.camera, view.pose, rect);
            let error = |background| squared_error(frame, &view.image, background);
            0.5 * (error(1.0) + error(0.0)) / pixels as f64
        };
        let new = || FrameBuffers::new(self.views.size());
        let errors = views
            .par_iter()
            .zip(rects)
            .filter(|_| !self.cancellation.is_cancelled())
            .map(|(view, rect)| self.frames.with(new, |frame| error(frame, view, *rect)))
            .collect();
        Ok(errors)
    }

    fn solve_texture(&mut self, low: &mut LowPoly, terms: LeastSquares<'_>) -> Result<(), Infallible> {
        solve_texture(low, &self.views.every(terms.view_stride), terms, self.cancellation);
        Ok(())
    }

    fn draw(&mut self, low: &LowPoly, view: usize) -> Result<Drawing, Infallible> {
        let (view, size) = (self.views.views[view], self.views.size());
        let mut frame = FrameBuffers::new(size);
        frame.render(low, &view.camera, view.pose, Rect { x0: 0, y0: 0, x1: size, y1: size });
        Ok(Drawing { ids: frame.raster.ids, colors: frame.image })
    }
}
