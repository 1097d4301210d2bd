//! The texture by gradient descent (paper 3.4), for fixed vertices: what [`super::solve_texture`] does in one solution.
//!
//! Over the same pixels: those that lie wholly on the source and on the level.

use glam::Vec4;
use rayon::prelude::*;

use super::LowPoly;
use super::optimise::{BATCH, BatchSlot, ViewOrder};
use super::optimizer::Adam;
use crate::Cancellation;
use crate::render::{Rect, View};

/// First step of a texel, as a part of full scale.
const RATE: f32 = 0.03;
/// Factor on it over all steps.
const DECAY: f32 = 0.1;
/// ViewOrder in which views are taken.
const SEED: u64 = 1;

/// How to optimise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureAdam {
    /// Steps of two views.
    pub steps: u32,
    /// Weight of the image gradient in the loss.
    pub gradient_weight: f32,
}

/// Moves the texture of `low` towards the one that fits `views` best, starting from the present one. `rects` are the
/// pixels that the source covers in each view.
pub fn optimise_texture(
    low: &mut LowPoly,
    views: &[&View],
    rects: &[Rect],
    smoothness: f32,
    descent: &TextureAdam,
    cancellation: &Cancellation,
) {
    let Some(size) = views.first().map(|view| view.image.size) else { return };
    let mut slots = BatchSlot::batch(size);
    let mut order = ViewOrder::new(views.len(), SEED);
    let mut adam = Adam::new(4 * low.texels.len());
    let (initial, mut seen) = (low.texels.clone(), low.covered.clone());
    let mut rate = RATE;
    let decay = libm::powf(DECAY, 1.0 / descent.steps.max(1) as f32);
    // Of a texel difference against the errors of one view's pixels, as in the least squares over all of them.
    let smoothness = smoothness * 2.0 / ((size * size) as f32 * views.len() as f32);
    let mut gradient = vec![Vec4::ZERO; low.texels.len()];
    for _ in (0..descent.steps).take_while(|_| !cancellation.is_cancelled()) {
        let chosen: [usize; BATCH] = std::array::from_fn(|_| order.next());
        let shared = &*low;
        slots.par_iter_mut().zip(chosen).with_max_len(1).for_each(|(slot, i)| {
            let view = views[i];
            slot.frame.render(shared, &view.camera, view.pose, rects[i]);
            slot.loss.run(&slot.frame, &view.image, 0.0, descent.gradient_weight);
            slot.gradients.run_texture(shared, &slot.frame, &view.image, &slot.loss.gradient);
        });
        gradient.fill(Vec4::ZERO);
        for slot in &slots {
            gradient.iter_mut().zip(&slot.gradients.texels).for_each(|(a, b)| *a += *b / BATCH as f32);
        }
        seen.iter_mut().zip(&gradient).for_each(|(seen, g)| *seen |= *g != Vec4::ZERO);
        add_smoothness(low, &initial, smoothness, &mut gradient);
        adam.step(bytemuck::cast_slice_mut(&mut low.texels), bytemuck::cast_slice(&gradient), rate);
        rate *= decay;
    }
    low.texels.iter_mut().for_each(|texel| *texel = texel.clamp(Vec4::ZERO, Vec4::ONE).with_w(1.0));
    crate::texture::fill(&mut low.texels, &seen, low.size);
}

/// The expectation of `L_tex` under small perturbations, taken of the change since `initial`: adds the gradient of
/// `weight / 2` times the squared differences of how much neighbouring texels change; returns that loss.
fn add_smoothness(low: &LowPoly, initial: &[Vec4], weight: f32, gradient: &mut [Vec4]) -> f64 {
    let size = low.size;
    let mut loss = 0.0;
    for i in (0..gradient.len()).filter(|&i| low.covered[i]) {
        for (j, inside) in [(i + 1, i % size + 1 < size), (i + size, i + size < gradient.len())] {
            if inside && low.covered[j] {
                let change = |i: usize| low.texels[i] - initial[i];
                let difference = change(i) - change(j);
                gradient[i] += difference * weight;
                gradient[j] -= difference * weight;
                loss += f64::from(0.5 * weight * difference.length_squared());
            }
        }
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Atlas, TriMesh};

    #[test]
    fn smoothness_matches_central_differences_and_stays_on_covered_texels() {
        let texels: Vec<Vec4> = (0..9u8).map(|i| Vec4::new(f32::from(i * i) / 81.0, 0.3, 0.0, 1.0)).collect();
        let covered = vec![true, true, false, true, true, true, true, true, true];
        let mut low = LowPoly::new(&TriMesh::default(), &Atlas::default(), false, 3, texels, covered);
        let initial: Vec<Vec4> = (0..9u8).map(|i| Vec4::splat(f32::from(i % 4) / 8.0)).collect();
        let mut gradient = vec![Vec4::ZERO; 9];
        add_smoothness(&low, &initial, 0.8, &mut gradient);
        assert_eq!(gradient[2], Vec4::ZERO);
        for (i, gradient) in gradient.iter().enumerate() {
            let mut at = |h: f32| {
                low.texels[i].x += h;
                let loss = add_smoothness(&low, &initial, 0.8, &mut [Vec4::ZERO; 9]);
                low.texels[i].x -= h;
                loss
            };
            let difference = (at(0.01) - at(-0.01)) / 0.02;
            assert!((difference - f64::from(gradient.x)).abs() < 1e-4, "{difference} {}", gradient.x);
        }
    }
}
