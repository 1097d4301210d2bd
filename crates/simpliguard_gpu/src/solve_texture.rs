//! The least squares of a texture, from the views to the solution.

use simpliguard::refine::{CoarseSolution, LeastSquares, LowPoly};
use wgpu::Buffer;

use crate::error::GpuError;
use crate::frame::Terms;
use crate::kernels::Slot;
use crate::renderer::Renderer;
use crate::texture_least_squares::TextureSolver;

/// Iterations that are sent to the device at once.
const PIECE: usize = 5;

impl Renderer<'_> {
    /// Replaces the texture of `low` by the one that fits the views best.
    pub(crate) fn try_solve_texture(&mut self, low: &mut LowPoly, terms: LeastSquares<'_>) -> Result<(), GpuError> {
        self.update(low, 1)?;
        let solver = match self.solver.take() {
            Some(solver) => solver,
            None => TextureSolver::new(self.gpu, low.texture.size)?,
        };
        let coarse = match terms.coarse {
            Some(CoarseSolution { texels, change, .. }) => [texels.as_slice(), change].concat(),
            None => Vec::new(),
        };
        let coarse = self.gpu.buffer_of("the coarse texture", &coarse)?;
        let own: Vec<(Slot, &Buffer)> = solver.bindings().chain([(Slot::Coarse, &coarse)]).collect();
        for (k, view) in (0..self.views.views.len()).step_by(terms.view_stride).enumerate() {
            if self.cancellation.is_cancelled() {
                break;
            }
            self.prepare(low, 0, view, self.terms(terms));
            let bindings = self.bindings(0, view).and(own.iter().copied());
            self.submit(|pass| {
                if k == 0 {
                    solver.clear(self.gpu, pass, &bindings);
                }
                self.frames[0].assemble(self.gpu, pass, &bindings);
            })?;
        }
        if !self.cancellation.is_cancelled() && !self.views.views.is_empty() {
            let bindings = self.bindings(0, 0).and(own.iter().copied());
            self.submit(|pass| solver.begin(self.gpu, pass, &bindings))?;
            for first in (0..terms.iterations).step_by(PIECE) {
                let count = PIECE.min(terms.iterations - first);
                self.submit(|pass| solver.go_on(self.gpu, pass, &bindings, count))?;
            }
            let bytes = self.read(&[solver.solution()])?;
            solver.take(&bytes, &mut low.texture);
        }
        self.solver = Some(solver);
        Ok(())
    }

    fn terms(&self, LeastSquares { pixel_stride, smoothness, coarse, .. }: LeastSquares<'_>) -> Terms {
        Terms {
            smoothness,
            pixel_stride: pixel_stride as u32,
            pixel_weight: self.views.pixel_weight() * pixel_stride.pow(2) as f32,
            coarse_size: coarse.map_or(0, |coarse| coarse.size as u32),
            trust: coarse.map_or(1.0, |coarse| coarse.scale),
            ..Terms::default()
        }
    }
}
