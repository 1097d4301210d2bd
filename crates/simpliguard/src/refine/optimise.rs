//! The loop: a few views a step, vertices by Adam, the texture fitted again now and then, the best iterate kept.
//!
//! The first steps may compare pictures of half the size, on a texture of half the size: they cost a quarter, and each
//! pixel's gradient reaches twice as far.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::backward::Gradients;
use super::constraints::Constraints;
use super::distance::SourceDistance;
use super::forward::FrameBuffers;
use super::image_loss::Loss;
use super::optimizer::Adam;
use super::regularisation::Regularisation;
use super::train_validation::TrainValidationSplit;
use super::{LowPoly, Skin, TextureFit};
use crate::geometry::{Bvh, Random};
use crate::render::View;
use crate::{Cancellation, Context, Error};

/// Views a step.
pub(super) const BATCH: usize = 2;
/// Steps between two fits of the texture.
const FIT_EVERY: u32 = 25;
/// Most views of half size that the texture is fitted to.
const COARSE_FIT_VIEWS: usize = 40;
/// First step of a skin weight.
const WEIGHT_RATE: f32 = 0.01;
/// Length of the last step as a part of the first; those between fall exponentially.
const LAST_STEP: f32 = 0.03;

/// How to refine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefineParams {
    /// Vertex steps; none fits the texture alone.
    pub steps: u32,
    /// Part of them that is taken at half size.
    pub coarse: f32,
    /// Length of the first step as a part of the mean edge.
    pub step_length: f32,
    /// How the texture is fitted; `None` leaves it as it is.
    pub texture: Option<TextureFit>,
    /// Weight of the image gradient in the loss.
    pub gradient_weight: f32,
    /// Weight of the Laplacian of the displacement, with the source's radius as unit of length.
    pub laplacian_weight: f32,
    /// Weight of the squared distance to the source, with the mean edge as unit of length.
    pub distance_weight: f32,
    /// Weight of the consistency of normals.
    pub normal_weight: f32,
    /// ViewOrder in which views are taken.
    pub seed: u64,
}

/// What refinement gained, in dB over views that it did not fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Refined {
    /// With the initial texture.
    pub psnr_initial: f32,
    /// With the fitted texture on the vertices it was given.
    pub psnr_texture: f32,
    /// At the end.
    pub psnr: f32,
}

/// What a mesh is fitted to.
pub struct ViewTarget<'a> {
    /// The source's pictures.
    pub views: &'a [View],
    /// The same at half the size, or none.
    pub half_resolution: &'a [View],
    /// Over the source's triangles.
    pub bvh: &'a Bvh,
    /// Of the source.
    pub radius: f32,
}

/// Fits `low` to the views, and `skin` to those in other poses. Never ends worse than it began by the views held out.
///
/// # Errors
/// If cancelled.
pub fn refine(
    low: &mut LowPoly,
    skin: Option<&mut Skin<'_>>,
    target: &ViewTarget<'_>,
    params: &RefineParams,
    asset: &str,
    context: &Context<'_>,
) -> Result<Refined, Error> {
    let split = TrainValidationSplit::new(target.views, &context.cancellation);
    let refined = fit_to(low, &split, params.texture.as_ref());
    if params.steps == 0 || low.triangles.is_empty() {
        return Ok(refined);
    }
    let psnr = Optimisation::new(low, target, params, asset, context).run(
        low,
        skin,
        target.half_resolution,
        &split,
        refined.psnr,
    )?;
    Ok(Refined { psnr, ..refined })
}

/// Fits the texture alone, if that gains anything.
pub fn fit_texture(
    low: &mut LowPoly,
    views: &[View],
    fit: Option<&TextureFit>,
    cancellation: &Cancellation,
) -> Refined {
    fit_to(low, &TrainValidationSplit::new(views, cancellation), fit)
}

fn fit_to(low: &mut LowPoly, split: &TrainValidationSplit<'_>, fit: Option<&TextureFit>) -> Refined {
    let psnr_initial = split.score(low);
    let Some(fit) = fit else { return Refined { psnr_initial, psnr_texture: psnr_initial, psnr: psnr_initial } };
    let initial = low.texels.clone();
    split.fit(low, Some(fit));
    let psnr_texture = split.score(low);
    if psnr_texture < psnr_initial {
        low.texels = initial;
    }
    Refined { psnr_initial, psnr_texture, psnr: psnr_texture.max(psnr_initial) }
}

/// Everything one view of a batch needs.
pub(super) struct BatchSlot {
    pub(super) frame: FrameBuffers,
    pub(super) loss: Loss,
    pub(super) gradients: Gradients,
}

impl BatchSlot {
    /// One for each view of a batch, for pictures of this side.
    pub(super) fn batch(size: usize) -> [Self; BATCH] {
        let slot = || Self { frame: FrameBuffers::new(size), loss: Loss::default(), gradients: Gradients::default() };
        std::array::from_fn(|_| slot())
    }
}

/// The best iterate so far.
struct Best {
    psnr: f32,
    positions: Vec<Vec3>,
    texels: Vec<Vec4>,
    weights: Vec<[f32; 4]>,
}

impl Best {
    fn new(psnr: f32, low: &LowPoly, skin: Option<&Skin<'_>>) -> Self {
        let weights = skin.map_or_else(Vec::new, Skin::weights);
        Self { psnr, positions: low.positions.clone(), texels: low.texels.clone(), weights }
    }

    fn restore(&self, low: &mut LowPoly, skin: Option<&mut Skin<'_>>) {
        low.positions.clone_from(&self.positions);
        low.texels.clone_from(&self.texels);
        if let Some(skin) = skin {
            skin.set_weights(&self.weights);
            skin.move_into_all(low);
        }
    }
}

/// Vertices on their way, over all sizes of pictures.
struct Optimisation<'a> {
    params: &'a RefineParams,
    asset: &'a str,
    context: &'a Context<'a>,
    guard: Constraints,
    structure: Regularisation,
    distance: SourceDistance<'a>,
    /// Weight of the distance beside the views at full size. The more views there are, the less they leave to it.
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

impl<'a> Optimisation<'a> {
    fn new(
        low: &LowPoly,
        target: &ViewTarget<'a>,
        params: &'a RefineParams,
        asset: &'a str,
        context: &'a Context<'a>,
    ) -> Self {
        let (vertices, edge) = (low.positions.len(), low.mean_edge());
        let laplacian_weight = params.laplacian_weight / (target.radius * target.radius);
        let distance_weight = params.distance_weight / (edge * edge);
        Self {
            params,
            asset,
            context,
            guard: Constraints::new(low),
            structure: Regularisation::new(low, laplacian_weight, params.normal_weight),
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

    /// The first steps at half size, the rest at full size; returns the PSNR at the end, having begun at `psnr`.
    fn run(
        mut self,
        low: &mut LowPoly,
        mut skin: Option<&mut Skin<'_>>,
        half_resolution: &[View],
        split: &TrainValidationSplit<'_>,
        psnr: f32,
    ) -> Result<f32, Error> {
        let mut best = Best::new(psnr, low, skin.as_deref());
        let coarse =
            if half_resolution.is_empty() { 0 } else { (self.params.coarse * self.params.steps as f32) as u32 };
        if coarse > 0 {
            let mut half = low.halved();
            let split_half = TrainValidationSplit::new(half_resolution, &self.context.cancellation)
                .fitting_texture_to(COARSE_FIT_VIEWS);
            split_half.fit(&mut half, self.params.texture.as_ref());
            let psnr = split_half.score(&half);
            let part = split.fitted.len() as f32 / split_half.fitted.len().max(1) as f32;
            self.distance.set_weight(self.distance_weight * part);
            self.optimise(&mut half, skin.as_deref_mut(), &split_half, coarse, psnr)?;
            self.distance.set_weight(self.distance_weight);
            (low.positions, low.motions) = (half.positions, half.motions);
            split.fit(low, self.params.texture.as_ref());
            let psnr = split.score(low);
            if psnr > best.psnr {
                best = Best::new(psnr, low, skin.as_deref());
            } else {
                best.restore(low, skin.as_deref_mut());
            }
        }
        self.optimise(low, skin, split, self.params.steps - coarse, best.psnr)
    }

    /// Takes `steps` steps against the views of `split`, and goes back to the best iterate. Returns its PSNR, having begun
    /// at `psnr`.
    fn optimise(
        &mut self,
        low: &mut LowPoly,
        mut skin: Option<&mut Skin<'_>>,
        split: &TrainValidationSplit<'_>,
        steps: u32,
        psnr: f32,
    ) -> Result<f32, Error> {
        let mut slots = BatchSlot::batch(split.size());
        let mut order = ViewOrder::new(split.fitted.len(), self.params.seed);
        let mut best = Best::new(psnr, low, skin.as_deref());
        for step in 1..=steps {
            self.context.check(self.asset)?;
            self.step(low, skin.as_deref_mut(), split, &mut slots, &mut order);
            if !step.is_multiple_of(FIT_EVERY) && step < steps {
                continue;
            }
            self.guard.roll_back_invalid_steps(low);
            if let Some(skin) = &skin {
                skin.move_into_all(low);
            }
            self.context.check(self.asset)?;
            split.fit(low, self.params.texture.as_ref());
            let psnr = split.score(low);
            tracing::trace!(step = self.step, size = split.size(), psnr, "refine");
            if psnr > best.psnr {
                best = Best::new(psnr, low, skin.as_deref());
            }
            self.context.check(self.asset)?;
            self.distance.find_planes(low);
        }
        best.restore(low, skin);
        Ok(best.psnr)
    }

    fn step(
        &mut self,
        low: &mut LowPoly,
        skin: Option<&mut Skin<'_>>,
        split: &TrainValidationSplit<'_>,
        slots: &mut [BatchSlot; BATCH],
        order: &mut ViewOrder,
    ) {
        self.step += 1;
        // Black and white by turns: a vertex that fits both fits the outline, not the background.
        let background = if self.step.is_multiple_of(2) { 1.0 } else { 0.0 };
        let chosen: [usize; BATCH] = std::array::from_fn(|_| order.next());
        if let Some(skin) = &skin {
            chosen.iter().for_each(|&i| skin.move_into(split.fitted[i].pose, low));
        }
        let shared = &*low;
        slots.par_iter_mut().zip(chosen).with_max_len(1).for_each(|(slot, i)| {
            let (view, rect) = (split.fitted[i], split.fitted_rects[i]);
            slot.frame.render(shared, &view.camera, view.pose, rect);
            slot.loss.run(&slot.frame, &view.image, background, self.params.gradient_weight);
            let (matrix, pose) = (&view.camera.view_projection, view.pose);
            slot.gradients.run(shared, matrix, pose, &slot.frame, &slot.loss.gradient);
        });
        if let Some(skin) = skin {
            let mut gradient = vec![Vec4::ZERO; low.positions.len()];
            for (slot, i) in slots.iter().zip(chosen) {
                let (pose, posed) = (split.fitted[i].pose, &slot.gradients.posed);
                skin.add_gradient(pose, &low.positions, posed, 1.0 / BATCH as f32, &mut gradient);
            }
            skin.step(&mut self.weight_adam, gradient, self.weight_rate);
        }
        let mut gradient: Vec<Vec3> = vec![Vec3::ZERO; low.positions.len()];
        for slot in slots {
            gradient.iter_mut().zip(&slot.gradients.positions).for_each(|(a, b)| *a += *b / BATCH as f32);
        }
        self.structure.add_gradient(&low.positions, &mut gradient);
        self.distance.add_gradient(low, &mut gradient);
        self.adam.step(bytemuck::cast_slice_mut(&mut low.positions), bytemuck::cast_slice(&gradient), self.rate);
        self.rate *= self.decay;
        self.weight_rate *= self.decay;
    }
}

/// Views in random order, each once before any comes again.
pub(super) struct ViewOrder {
    random: Random,
    views: Vec<usize>,
    at: usize,
}

impl ViewOrder {
    pub(super) fn new(views: usize, seed: u64) -> Self {
        Self { random: Random::new(seed), views: (0..views).collect(), at: views }
    }

    pub(super) fn next(&mut self) -> usize {
        if self.at == self.views.len() {
            for i in (1..self.views.len()).rev() {
                self.views.swap(i, (self.random.bits() % (i as u64 + 1)) as usize);
            }
            self.at = 0;
        }
        self.at += 1;
        self.views[self.at - 1]
    }
}
