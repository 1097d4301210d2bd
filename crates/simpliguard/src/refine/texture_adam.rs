//! The texture by gradient descent (paper 3.4), for fixed vertices. [`super::texture_least_squares`] finds it in one
//! solution.
//!
//! Both use the same pixels: those that lie wholly on the source and on the level.

use glam::{Vec2, Vec4};
use rayon::prelude::*;

use super::backend::BATCH;
use super::batch::Batch;
use super::covered_views::CoveredViews;
use super::cpu::BatchSlot;
use super::lookup::Lookup;
use super::low_poly::{LowPoly, TexelGrid};
use super::optimizer::Adam;
use super::params::TextureAdam;
use crate::Cancellation;
use crate::geometry::Random;
use crate::render::fill_unknown;

/// First step of a texel, as a fraction of full scale.
const RATE: f32 = 0.03;
/// Length of the last step as a fraction of the first.
const DECAY: f32 = 0.1;
/// Seed of the order in which views are taken, and of the perturbations.
const SEED: u64 = 1;
/// Points that are perturbed in each step, as a fraction of the texels.
const PERTURBED: usize = 8;

/// Moves the texture of `low` towards the one that fits `views` best, starting from the present one.
pub(super) fn optimise_texture(
    low: &mut LowPoly,
    views: &CoveredViews<'_>,
    smoothness: f32,
    params: &TextureAdam,
    cancellation: &Cancellation,
) {
    if views.len() == 0 {
        return;
    }
    let (mut batch, mut random) = (Batch::new(views.len(), SEED), Random::new(SEED));
    let mut slots: [BatchSlot; BATCH] = std::array::from_fn(|_| BatchSlot::new(views.size()));
    let mut adam = Adam::new(4 * low.texture.texels.len());
    let (initial, mut seen) = (low.texture.texels.clone(), low.texture.covered.clone());
    let mut rate = RATE;
    let decay = libm::powf(DECAY, 1.0 / params.steps.max(1) as f32);
    // Of a texel difference against the errors of one view's pixels, as in the least squares over all of them.
    let smoothness = smoothness * 2.0 / ((views.size() * views.size()) as f32 * views.len() as f32);
    let mut gradient = vec![Vec4::ZERO; low.texture.texels.len()];
    for _ in (0..params.steps).take_while(|_| !cancellation.is_cancelled()) {
        batch.draw();
        differentiate(low, views, (batch.views, &mut slots), params.gradient_weight);
        gradient.fill(Vec4::ZERO);
        for slot in &slots {
            gradient.iter_mut().zip(&slot.gradients.texels).for_each(|(a, b)| *a += *b / BATCH as f32);
        }
        seen.iter_mut().zip(&gradient).for_each(|(seen, g)| *seen |= *g != Vec4::ZERO);
        if params.perturbation > 0.0 {
            let points = random_points(&low.texture, params.perturbation, &mut random);
            add_perturbation(&low.texture, &points, smoothness / params.perturbation.powi(2), &mut gradient);
        } else {
            add_smoothness(&low.texture, &initial, smoothness, &mut gradient);
        }
        adam.step(bytemuck::cast_slice_mut(&mut low.texture.texels), bytemuck::cast_slice(&gradient), rate);
        rate *= decay;
    }
    let TexelGrid { size, texels, .. } = &mut low.texture;
    texels.iter_mut().for_each(|texel| *texel = texel.clamp(Vec4::ZERO, Vec4::ONE).with_w(1.0));
    fill_unknown(texels, &seen, *size);
}

/// Renders the views of the batch and carries the image loss back to the texels.
fn differentiate(
    low: &LowPoly,
    views: &CoveredViews<'_>,
    (batch, slots): ([usize; BATCH], &mut [BatchSlot; BATCH]),
    gradient_weight: f32,
) {
    slots.par_iter_mut().zip(batch).with_max_len(1).for_each(|(slot, index)| {
        let view = views.views[index];
        slot.frame.render(low, &view.camera, view.pose, views.rects[index]);
        slot.loss.run(&slot.frame, &view.image, 0.0, gradient_weight);
        slot.gradients.backward_to_texels(low, &slot.frame, &view.image, &slot.loss.gradient);
    });
}

/// Adds the gradient of `weight / 2` times the squared differences between the changes of neighbouring texels since
/// `initial`; returns that loss. It is the expectation of `L_tex` under small perturbations, taken of the change.
fn add_smoothness(texture: &TexelGrid, initial: &[Vec4], weight: f32, gradient: &mut [Vec4]) -> f64 {
    let size = texture.size;
    let mut loss = 0.0;
    for i in (0..gradient.len()).filter(|&i| texture.covered[i]) {
        for (j, inside) in [(i + 1, i % size + 1 < size), (i + size, i + size < gradient.len())] {
            if inside && texture.covered[j] {
                let change = |i: usize| texture.texels[i] - initial[i];
                let difference = change(i) - change(j);
                gradient[i] += difference * weight;
                gradient[j] -= difference * weight;
                loss += f64::from(0.5 * weight * difference.length_squared());
            }
        }
    }
    loss
}

/// Random points on the covered texels, and the same points perturbed by a normal distribution of this deviation in texels,
/// as far as those are covered.
fn random_points(texture: &TexelGrid, deviation: f32, random: &mut Random) -> Vec<[Vec2; 2]> {
    let side = texture.size as f32;
    let is_covered = |p: Vec2| {
        let inside = p.cmpge(Vec2::ZERO).all() && p.cmplt(Vec2::splat(side)).all();
        inside && texture.covered[p.y as usize * texture.size + p.x as usize]
    };
    let mut pair = |_| {
        let point = Vec2::new(random.unit(), random.unit()) * side;
        // Box and Muller 1958.
        let radius = (-2.0 * libm::logf(1.0 - random.unit())).sqrt() * deviation;
        let (sin, cos) = libm::sincosf(random.unit() * std::f32::consts::TAU);
        [point, point + Vec2::new(cos, sin) * radius]
    };
    (0..texture.texels.len() / PERTURBED).map(&mut pair).filter(|pair| pair.iter().all(|p| is_covered(*p))).collect()
}

/// Adds the gradient of `weight / 2` times the squared differences of the colours at pairs of points, as if there were a
/// pair for every texel; returns that loss. It is `L_tex` of the paper.
fn add_perturbation(texture: &TexelGrid, points: &[[Vec2; 2]], weight: f32, gradient: &mut [Vec4]) -> f64 {
    let (size, weight) = (texture.size, weight * PERTURBED as f32);
    let mut loss = 0.0;
    for pair in points {
        let lookups = pair.map(|point| Lookup::new(point, size));
        let [a, b] = lookups.map(|lookup| lookup.sample(&texture.texels, size));
        let difference = a - b;
        for (lookup, sign) in lookups.iter().zip([1.0, -1.0]) {
            for (texel, share) in lookup.texels(size).into_iter().zip(lookup.weights()) {
                gradient[texel] += difference * (sign * weight * share);
            }
        }
        loss += f64::from(0.5 * weight * difference.length_squared());
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn perturbed_points_stay_on_covered_texels_and_match_central_differences() {
        let texels: Vec<Vec4> = (0..64u8).map(|i| Vec4::new(f32::from(i % 9) / 9.0, 0.3, 0.0, 1.0)).collect();
        let covered: Vec<bool> = (0..64).map(|i| i % 8 < 5).collect();
        let mut texture = TexelGrid { size: 8, texels, covered, opacity: Vec::new() };
        let mut random = Random::new(3);
        let points: Vec<[Vec2; 2]> = (0..9).flat_map(|_| random_points(&texture, 0.7, &mut random)).collect();
        assert!(points.len() > 20 && points.iter().flatten().all(|p| p.x < 5.0), "{points:?}");
        let mut gradient = vec![Vec4::ZERO; 64];
        add_perturbation(&texture, &points, 0.01, &mut gradient);
        for i in [9, 20, 36] {
            let mut at = |h: f32| {
                texture.texels[i].x += h;
                let loss = add_perturbation(&texture, &points, 0.01, &mut [Vec4::ZERO; 64]);
                texture.texels[i].x -= h;
                loss
            };
            let difference = (at(0.01) - at(-0.01)) / 0.02;
            assert!((difference - f64::from(gradient[i].x)).abs() < 1e-4, "{difference} {}", gradient[i].x);
        }
    }

    #[test]
    fn smoothness_matches_central_differences_and_stays_on_covered_texels() {
        let texels: Vec<Vec4> = (0..9u8).map(|i| Vec4::new(f32::from(i * i) / 81.0, 0.3, 0.0, 1.0)).collect();
        let covered = vec![true, true, false, true, true, true, true, true, true];
        let mut texture = TexelGrid { size: 3, texels, covered, opacity: Vec::new() };
        let initial: Vec<Vec4> = (0..9u8).map(|i| Vec4::splat(f32::from(i % 4) / 8.0)).collect();
        let mut gradient = vec![Vec4::ZERO; 9];
        add_smoothness(&texture, &initial, 0.8, &mut gradient);
        assert_eq!(gradient[2], Vec4::ZERO);
        for (i, gradient) in gradient.iter().enumerate() {
            let mut at = |h: f32| {
                texture.texels[i].x += h;
                let loss = add_smoothness(&texture, &initial, 0.8, &mut [Vec4::ZERO; 9]);
                texture.texels[i].x -= h;
                loss
            };
            let difference = (at(0.01) - at(-0.01)) / 0.02;
            assert!((difference - f64::from(gradient.x)).abs() < 1e-4, "{difference} {}", gradient.x);
        }
    }
}
