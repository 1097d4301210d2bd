//! The loop: a few views a step, vertices by Adam, the texture solved again now and then, the best iterate kept.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::adam::Adam;
use super::backward::Gradients;
use super::forward::Frame;
use super::guard::Guard;
use super::loss::{Loss, squared_error};
use super::regularise::Laplacian;
use super::{LowPoly, Skin, solve_texture};
use crate::render::{Picture, Random, Rect, View};
use crate::{Cancellation, Context, Error};

/// Views a step.
const BATCH: usize = 2;
/// One view in this many is held out to judge by.
const HELD_OUT: usize = 6;
/// Weight of the image gradient in the loss.
const GRADIENT_WEIGHT: f32 = 0.5;
/// Weight of the Laplacian of the displacement, with the source's radius as unit of length.
const LAPLACIAN_WEIGHT: f32 = 0.02;
/// First step of a skin weight.
const WEIGHT_RATE: f32 = 0.01;
/// Factor on the step length from step to step.
const DECAY: f32 = 0.992;
/// Factor on the step length after steps that gained nothing.
const BACKTRACK: f32 = 0.3;
/// Iterations of the texture's conjugate gradients.
const SOLVE_ITERATIONS: usize = 30;

/// How to refine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Vertex steps; none fits the texture alone.
    pub steps: u32,
    /// First step length as a part of the mean edge.
    pub step_length: f32,
    /// Weight of the texture's smoothness, in pixels; `None` leaves the texture as it is.
    pub smoothness: Option<f32>,
    /// Steps between two solutions of the texture.
    pub resolve_every: u32,
    /// Order in which views are taken.
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

/// Fits `low` to the views, and `skin` to those in other poses, `radius` being the source's. Never ends worse than it
/// began by the views held out.
///
/// # Errors
/// If cancelled.
pub fn refine(
    low: &mut LowPoly,
    skin: Option<&mut Skin<'_>>,
    views: &[View],
    radius: f32,
    params: &Params,
    asset: &str,
    context: &Context<'_>,
) -> Result<Refined, Error> {
    let split = Split::new(views, &context.cancellation);
    let mut refined = Refined { psnr_initial: split.judge(low), ..Refined::default() };
    let initial = low.texels.clone();
    split.solve(low, params.smoothness);
    refined.psnr_texture = split.judge(low);
    refined.psnr = refined.psnr_texture;
    if refined.psnr_texture < refined.psnr_initial {
        low.texels = initial;
        refined.psnr = refined.psnr_initial;
    }
    if params.steps > 0 && !low.triangles.is_empty() {
        refined.psnr = descend(low, skin, &split, radius, params, refined.psnr, asset, context)?;
    }
    Ok(refined)
}

/// Fits the texture alone, if that gains anything; returns the PSNR over the views held out, in dB.
pub fn fit_texture(low: &mut LowPoly, views: &[View], smoothness: Option<f32>, cancellation: &Cancellation) -> f32 {
    let split = Split::new(views, cancellation);
    let before = split.judge(low);
    let initial = low.texels.clone();
    split.solve(low, smoothness);
    let after = split.judge(low);
    if after < before {
        low.texels = initial;
    }
    after.max(before)
}

/// Views to fit and views to judge by.
struct Split<'a> {
    fitted: Vec<&'a View>,
    fitted_rects: Vec<Rect>,
    held_out: Vec<&'a View>,
    held_out_rects: Vec<Rect>,
    cancellation: &'a Cancellation,
}

impl<'a> Split<'a> {
    fn new(views: &'a [View], cancellation: &'a Cancellation) -> Self {
        let pick = |held: bool| -> Vec<&View> {
            let chosen = views.iter().enumerate().filter(|(i, _)| (i % HELD_OUT == HELD_OUT / 2) == held);
            chosen.map(|(_, v)| v).collect()
        };
        let (fitted, held_out) = (pick(false), pick(true));
        let rects = |views: &[&View]| views.iter().map(|v| covered_rect(&v.picture)).collect();
        let (fitted_rects, held_out_rects) = (rects(&fitted), rects(&held_out));
        Self { fitted, fitted_rects, held_out, held_out_rects, cancellation }
    }

    fn solve(&self, low: &mut LowPoly, smoothness: Option<f32>) {
        if let Some(smoothness) = smoothness {
            let (views, rects) = (&self.fitted, &self.fitted_rects);
            solve_texture(low, views, rects, smoothness, SOLVE_ITERATIONS, self.cancellation);
        }
    }

    /// Mean PSNR over the views held out, on white, in dB.
    fn judge(&self, low: &LowPoly) -> f32 {
        let errors: Vec<f64> = self
            .held_out
            .par_iter()
            .zip(&self.held_out_rects)
            .map_init(
                || Frame::new(self.held_out[0].picture.size),
                |frame, (view, rect)| {
                    frame.render(low, &view.camera, view.pose, *rect);
                    squared_error(frame, &view.picture, 1.0) / (3 * frame.size * frame.size) as f64
                },
            )
            .collect();
        let decibels = |e: &f64| -10.0 * libm::log10(e.max(1e-10));
        (errors.iter().map(decibels).sum::<f64>() / errors.len().max(1) as f64) as f32
    }
}

/// Everything one view of a batch needs.
struct Lane {
    frame: Frame,
    loss: Loss,
    gradients: Gradients,
}

fn descend(
    low: &mut LowPoly,
    mut skin: Option<&mut Skin<'_>>,
    split: &Split<'_>,
    radius: f32,
    params: &Params,
    start: f32,
    asset: &str,
    context: &Context<'_>,
) -> Result<f32, Error> {
    let size = split.fitted[0].picture.size;
    let lane = || Lane { frame: Frame::new(size), loss: Loss::default(), gradients: Gradients::default() };
    let mut lanes: Vec<Lane> = (0..BATCH).map(|_| lane()).collect();
    let origin = low.positions.clone();
    let guard = Guard::new(low);
    let laplacian = Laplacian::new(origin.len(), &low.triangles);
    let mut adam = Adam::new(3 * origin.len());
    let mut weight_adam = Adam::new(4 * origin.len());
    let mut weight_rate = WEIGHT_RATE;
    let mut order = Order::new(split.fitted.len(), params.seed);
    let mut rate = params.step_length * low.mean_edge();
    let weights = |skin: &Option<&mut Skin<'_>>| skin.as_ref().map_or_else(Vec::new, |skin| skin.weights());
    let mut best = (start, low.positions.clone(), low.texels.clone(), weights(&skin));
    for step in 1..=params.steps {
        context.check(asset)?;
        // Black and white by turns: a vertex that fits both fits the outline, not the background.
        let background = if step % 2 == 0 { 1.0 } else { 0.0 };
        let chosen: [usize; BATCH] = std::array::from_fn(|_| order.next());
        if let Some(skin) = &skin {
            chosen.iter().for_each(|&i| skin.move_into(split.fitted[i].pose, low));
        }
        let shared = &*low;
        lanes.par_iter_mut().zip(chosen).with_max_len(1).for_each(|(lane, i)| {
            let (view, rect) = (split.fitted[i], split.fitted_rects[i]);
            lane.frame.render(shared, &view.camera, view.pose, rect);
            lane.loss.run(&lane.frame, &view.picture, background, GRADIENT_WEIGHT);
            let (matrix, pose) = (&view.camera.view_projection, view.pose);
            lane.gradients.run(shared, matrix, pose, &lane.frame, &lane.loss.gradient);
        });
        let mut gradient: Vec<Vec3> = vec![Vec3::ZERO; origin.len()];
        for lane in &lanes {
            gradient.iter_mut().zip(&lane.gradients.positions).for_each(|(a, b)| *a += *b / BATCH as f32);
        }
        if let Some(skin) = &mut skin {
            let mut gradient = vec![Vec4::ZERO; origin.len()];
            for (lane, i) in lanes.iter().zip(chosen) {
                let (pose, posed) = (split.fitted[i].pose, &lane.gradients.posed);
                skin.add_gradient(pose, &low.positions, posed, 1.0 / BATCH as f32, &mut gradient);
            }
            skin.step(&mut weight_adam, gradient, weight_rate);
            weight_rate *= DECAY;
        }
        let moved: Vec<Vec3> = low.positions.iter().zip(&origin).map(|(a, b)| *a - *b).collect();
        laplacian.add_gradient(&moved, LAPLACIAN_WEIGHT / (radius * radius), &mut gradient);
        adam.step(bytemuck::cast_slice_mut(&mut low.positions), bytemuck::cast_slice(&gradient), rate);
        rate *= DECAY;
        if step % params.resolve_every.max(1) == 0 || step == params.steps {
            guard.take_back(low);
            if let Some(skin) = &skin {
                skin.move_into_all(low);
            }
            split.solve(low, params.smoothness);
            let psnr = split.judge(low);
            tracing::trace!(step, psnr, "refine");
            if psnr > best.0 {
                best = (psnr, low.positions.clone(), low.texels.clone(), weights(&skin));
            } else {
                // Too long a stride: from the best iterate on with shorter ones.
                (low.positions, low.texels) = (best.1.clone(), best.2.clone());
                adam = Adam::new(3 * origin.len());
                rate *= BACKTRACK;
                if let Some(skin) = &mut skin {
                    skin.set_weights(&best.3);
                    weight_adam = Adam::new(4 * origin.len());
                    weight_rate *= BACKTRACK;
                }
            }
        }
    }
    (low.positions, low.texels) = (best.1, best.2);
    if let Some(skin) = skin {
        skin.set_weights(&best.3);
        skin.move_into_all(low);
    }
    Ok(best.0)
}

/// Views in random order, each once before any comes again.
struct Order {
    random: Random,
    views: Vec<usize>,
    at: usize,
}

impl Order {
    fn new(views: usize, seed: u64) -> Self {
        Self { random: Random::new(seed), views: (0..views).collect(), at: views }
    }

    fn next(&mut self) -> usize {
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

/// The rectangle of pixels that the source touches.
fn covered_rect(picture: &Picture) -> Rect {
    let n = picture.size;
    let mut rect = Rect { x0: n, y0: n, x1: 0, y1: 0 };
    for y in 0..n {
        let row = &picture.pixels[y * n..(y + 1) * n];
        if let (Some(first), Some(last)) = (row.iter().position(|p| p[3] > 0), row.iter().rposition(|p| p[3] > 0)) {
            rect = Rect { x0: rect.x0.min(first), x1: rect.x1.max(last + 1), y0: rect.y0.min(y), y1: y + 1 };
        }
    }
    rect
}
