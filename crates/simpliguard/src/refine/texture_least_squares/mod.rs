//! The texture that fits all views best, for fixed vertices.
//!
//! Least squares over every pixel that lies wholly on the source and on the level, plus two terms. One is `smoothness` times
//! the squared differences between the changes of neighbouring texels. It is the expectation of the paper's `L_tex` under
//! small perturbations, taken of the change and not of the colour: a baked texture holds detail that no view resolves. The
//! other is a small pull towards the initial texture, which decides what no view sees. Pixels on silhouettes stay out: they
//! hold background.
//!
//! Solved by conjugate gradients with the diagonal as preconditioner; the channels share the matrix.

mod assemble;
mod coarse_solution;
mod conjugate_gradients;
mod normal_equations;

use glam::Vec4;

use self::assemble::assemble;
use self::coarse_solution::CoarseSolution;
use self::conjugate_gradients::conjugate_gradients;
use super::covered_views::CoveredViews;
use super::low_poly::{LowPoly, TexelGrid};
use crate::Cancellation;
use crate::render::fill_unknown;

/// Smallest smoothness of the coarse solution.
const COARSE_SMOOTHNESS: f32 = 2.0;
/// The coarse solution takes every second pixel of every second row: a texel of half the size has as many pixels as one of
/// the full size.
const COARSE_STRIDE: usize = 2;
/// Iterations of the conjugate gradients, and of those that start from a coarse solution.
const ITERATIONS: usize = 30;
const NESTED_ITERATIONS: usize = 8;

/// Replaces the texture of `low` by the one that fits `views` best, starting from the present one.
///
/// With a `trust`, a pixel counts by how well it agrees with a first, smoother solution of half the size (one step of
/// iteratively reweighted least squares, with Cauchy weights of this scale). Along inner outlines of the level a view may
/// show another surface of the source than the level does; so weighted, it leaves no specks. The solution at full size
/// starts from the change of the first one (nested iteration).
pub(super) fn solve_texture(
    low: &mut LowPoly,
    views: &CoveredViews<'_>,
    (smoothness, trust): (f32, Option<f32>),
    cancellation: &Cancellation,
) {
    let Some(scale) = trust else {
        return solve(low, views, smoothness, (1, None), cancellation);
    };
    let mut half = low.halved();
    let initial = half.texture.texels.clone();
    solve(&mut half, views, smoothness.max(COARSE_SMOOTHNESS), (COARSE_STRIDE, None), cancellation);
    let TexelGrid { size, texels, .. } = half.texture;
    let change = texels.iter().zip(initial).map(|(after, before)| *after - before).collect();
    let coarse = CoarseSolution { size, texels, change, scale };
    solve(low, views, smoothness, (1, Some(&coarse)), cancellation);
}

/// Solves with the pixels of every `stride`-th row and column, and starts from a coarse solution if there is one.
fn solve(
    low: &mut LowPoly,
    views: &CoveredViews<'_>,
    smoothness: f32,
    (stride, coarse): (usize, Option<&CoarseSolution>),
    cancellation: &Cancellation,
) {
    let mut equations = assemble(low, views, (stride, coarse), cancellation);
    let seen: Vec<bool> = equations.rows.iter().map(|row| row.a[0] > 0.0).collect();
    equations.regularise(&low.texture, smoothness);
    let TexelGrid { size, texels, covered, .. } = &mut low.texture;
    let iterations = coarse.map_or(ITERATIONS, |coarse| {
        coarse.add_change(texels, *size);
        NESTED_ITERATIONS
    });
    conjugate_gradients(&equations, texels, iterations, cancellation);
    for texel in texels.iter_mut() {
        *texel = texel.clamp(Vec4::ZERO, Vec4::ONE).with_w(1.0);
    }
    let known: Vec<bool> = covered.iter().zip(seen).map(|(covered, seen)| *covered || seen).collect();
    fill_unknown(texels, &known, *size);
}
