//! The loop: a few views a step, vertices by Adam, the texture fitted again now and then, the best iterate kept.
//!
//! The first steps may compare views of half the resolution, on a texture of half the size: they cost a quarter, and each
//! pixel's gradient reaches twice as far.

use glam::{Vec3, Vec4};

use super::backend::{BATCH, Backend, LossTerms, ViewGradient};
use super::batch::Batch;
use super::constraints::Constraints;
use super::losses::{Regularisation, SourceDistance};
use super::low_poly::LowPoly;
use super::optimizer::Adam;
use super::params::RefineParams;
use super::skin::{PosedGradient, Skin};
use super::train_validation::TrainValidationSplit;
use super::variables::{BestIterate, Variables};
use super::view_target::ViewTarget;
use crate::Cancellation;

/// Steps between two fits of the texture.
const FIT_EVERY: u32 = 25;
/// Most views of half the resolution that the texture is fitted to.
const COARSE_FIT_VIEWS: usize = 40;
/// Length of the first step of a skin weight.
const WEIGHT_RATE: f32 = 0.01;
/// Length of the last step as a fraction of the first. Steps between them shrink exponentially.
const LAST_STEP: f32 = 0.03;

/// The state of the optimisation over all steps, of both resolutions.
pub(super) struct Optimisation<'a, E> {
    backend: &'a dyn Backend<Error = E>,
    target: &'a ViewTarget<'a>,
    params: &'a RefineParams,
    cancellation: &'a Cancellation,
    /// Gradients of the views of a step.
    gradients: [ViewGradient; BATCH],
    constraints: Constraints,
    regularisation: Regularisation,
    distance: SourceDistance<'a>,
    /// Weight of the distance beside the views at full resolution. The more views there are, the less they leave to it.
    distance_weight: f32,
    adam: Adam,
    weight_adam: Adam,
    /// Step lengths of vertices and of skin weights.
    rate: f32,
    weight_rate: f32,
    /// Factor on both from step to step.
    decay: f32,
    step: u32,
}

impl<'a, E> Optimisation<'a, E> {
    /// Begins at `low`, whose faces the constraints compare later ones with.
    pub(super) fn new(
        low: &LowPoly,
        target: &'a ViewTarget<'a>,
        params: &'a RefineParams,
        backend: &'a dyn Backend<Error = E>,
        cancellation: &'a Cancellation,
    ) -> Self {
        let (vertices, edge) = (low.positions.len(), low.mean_edge());
        let laplacian_weight = params.laplacian_weight / (target.radius * target.radius);
        let distance_weight = params.distance_weight / (edge * edge);
        Self {
            backend,
            target,
            params,
            cancellation,
            gradients: Default::default(),
            constraints: Constraints::new(low),
            regularisation: match Regularisation::new(low, laplacian_weight, params.normal_weight) {
                of_positions if params.laplacian_of_positions => of_positions.of_positions(),
                of_displacements => of_displacements,
            },
            distance: SourceDistance::new(target.bvh, low, distance_weight),
            distance_weight,
            adam: Adam::new(3 * vertices),
            weight_adam: Adam::new(4 * vertices),
            rate: params.step_length * edge,
            weight_rate: WEIGHT_RATE,
            decay: libm::powf(LAST_STEP, 1.0 / params.steps.max(1) as f32),
            step: 0,
        }
    }

    /// Takes the first steps at half the resolution, the rest at full resolution. Returns the PSNR at the end, having begun
    /// at `psnr`.
    pub(super) fn run(
        mut self,
        mut variables: Variables<'_, '_>,
        split: &mut TrainValidationSplit<'_, E>,
        psnr: f32,
    ) -> Result<f32, E> {
        let RefineParams { steps, coarse, .. } = *self.params;
        let coarse = if self.target.half_resolution.is_empty() { 0 } else { (coarse * steps as f32) as u32 };
        let psnr = match coarse {
            0 => psnr,
            _ => self.optimise_coarse(&mut variables, split, coarse, psnr)?,
        };
        self.optimise(&mut variables, split, steps - coarse, psnr)
    }

    /// Takes `steps` steps against the views of half the resolution. Keeps the result if `split` scores it better than
    /// `psnr`, with the texture at full size fitted to it. Returns the PSNR.
    fn optimise_coarse(
        &mut self,
        variables: &mut Variables<'_, '_>,
        split: &mut TrainValidationSplit<'_, E>,
        steps: u32,
        psnr: f32,
    ) -> Result<f32, E> {
        let start = BestIterate::new(psnr, variables);
        let mut half = variables.low.halved();
        let mut half_split =
            TrainValidationSplit::new(self.target.half_resolution, &half, self.backend, self.cancellation)?
                .fitting_texture_to(COARSE_FIT_VIEWS);
        half_split.fit_texture(&mut half, self.params.texture.as_ref())?;
        let half_psnr = half_split.score(&half)?;
        let views = split.train.len() as f32 / half_split.train.len().max(1) as f32;
        self.distance.set_weight(self.distance_weight * views);
        let mut half_variables = Variables { low: &mut half, skin: variables.skin.as_deref_mut() };
        self.optimise(&mut half_variables, &mut half_split, steps, half_psnr)?;
        self.distance.set_weight(self.distance_weight);
        let low = &mut *variables.low;
        (low.positions, low.motions) = (half.positions, half.motions);
        split.fit_texture(low, self.params.texture.as_ref())?;
        let psnr = split.score(low)?;
        if psnr > start.psnr {
            return Ok(psnr);
        }
        start.restore(variables);
        Ok(start.psnr)
    }

    /// Takes `steps` steps against the training views, and goes back to the best iterate. Returns its PSNR, having begun at
    /// `psnr`. Ends early if cancelled.
    fn optimise(
        &mut self,
        variables: &mut Variables<'_, '_>,
        split: &mut TrainValidationSplit<'_, E>,
        steps: u32,
        psnr: f32,
    ) -> Result<f32, E> {
        let cancellation = self.cancellation;
        let mut batch = Batch::new(split.train.len(), self.target.seed);
        let mut best = BestIterate::new(psnr, variables);
        for step in (1..=steps).take_while(|_| !cancellation.is_cancelled()) {
            batch.draw();
            self.step(variables, split, batch.views)?;
            if !step.is_multiple_of(FIT_EVERY) && step < steps {
                continue;
            }
            self.constraints.roll_back_invalid_steps(variables.low);
            variables.update_all_motions();
            split.fit_texture(variables.low, self.params.texture.as_ref())?;
            let psnr = split.score(variables.low)?;
            tracing::trace!(step = self.step, size = split.train.size(), psnr, "refine");
            if psnr > best.psnr {
                best = BestIterate::new(psnr, variables);
            }
            self.distance.find_planes(variables.low);
        }
        best.restore(variables);
        Ok(best.psnr)
    }

    /// One step of the vertices and the skin weights, by these views.
    fn step(
        &mut self,
        variables: &mut Variables<'_, '_>,
        split: &mut TrainValidationSplit<'_, E>,
        views: [usize; BATCH],
    ) -> Result<(), E> {
        self.step += 1;
        let poses = views.map(|view| split.train.views[view].pose);
        poses.iter().for_each(|pose| variables.update_motions(*pose));
        // Black and white by turns: a vertex that fits both fits the outline, not the background.
        let background = if self.step.is_multiple_of(2) { 1.0 } else { 0.0 };
        let terms = LossTerms { background, gradient_weight: self.params.gradient_weight };
        split.train_renderer.differentiate(variables.low, views, terms, &mut self.gradients)?;
        let Variables { low, skin } = variables;
        if let Some(skin) = skin {
            self.step_weights(skin, &low.positions, poses);
        }
        self.step_vertices(low);
        self.rate *= self.decay;
        self.weight_rate *= self.decay;
        Ok(())
    }

    fn step_weights(&mut self, skin: &mut Skin<'_>, positions: &[Vec3], poses: [Option<usize>; BATCH]) {
        let mut gradient = vec![Vec4::ZERO; positions.len()];
        for (view, pose) in self.gradients.iter().zip(poses) {
            let posed = PosedGradient { pose, posed: &view.posed, factor: 1.0 / BATCH as f32 };
            skin.add_gradient(&posed, positions, &mut gradient);
        }
        skin.step(&mut self.weight_adam, gradient, self.weight_rate);
    }

    fn step_vertices(&mut self, low: &mut LowPoly) {
        let mut gradient = vec![Vec3::ZERO; low.positions.len()];
        for view in &self.gradients {
            gradient.iter_mut().zip(&view.positions).for_each(|(a, b)| *a += *b / BATCH as f32);
        }
        self.regularisation.add_gradient(&low.positions, &mut gradient);
        self.distance.add_gradient(low, &mut gradient);
        self.adam.step(bytemuck::cast_slice_mut(&mut low.positions), bytemuck::cast_slice(&gradient), self.rate);
    }
}
