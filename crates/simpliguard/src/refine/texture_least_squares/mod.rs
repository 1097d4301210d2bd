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
pub use self::coarse_solution::CoarseSolution;
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

/// Terms of the least squares of a texture.
#[derive(Clone, Copy, Debug)]
pub struct LeastSquares<'a> {
    /// One view in so many is fitted, from the first.
    pub view_stride: usize,
    /// The pixels of every so many-th row and column count.
    pub pixel_stride: usize,
    /// That of [`TextureFit`](super::TextureFit).
    pub smoothness: f32,
    /// Most iterations of the conjugate gradients.
    pub iterations: usize,
    /// A solution of half the size. The iteration starts from its change, and a pixel counts by how well it agrees with it.
    pub coarse: Option<&'a CoarseSolution>,
}

impl<'a> LeastSquares<'a> {
    /// All pixels of one view in `view_stride`.
    pub fn new(view_stride: usize, smoothness: f32) -> Self {
        Self { view_stride, pixel_stride: 1, smoothness, iterations: ITERATIONS, coarse: None }
    }

    /// The same for a texture of half the size, whose solution these start from.
    pub(super) fn halved(&self) -> Self {
        Self { pixel_stride: COARSE_STRIDE, smoothness: self.smoothness.max(COARSE_SMOOTHNESS), ..*self }
    }

    /// The same from a coarse solution on.
    pub(super) fn nested(self, coarse: &'a CoarseSolution) -> Self {
        Self { iterations: NESTED_ITERATIONS, coarse: Some(coarse), ..self }
    }
}

/// Replaces the texture of `low` by the one that fits `views` best, starting from the present one.
pub(super) fn solve_texture(
    low: &mut LowPoly,
    views: &CoveredViews<'_>,
    terms: LeastSquares<'_>,
    cancellation: &Cancellation,
) {
    let mut equations = assemble(low, views, terms, cancellation);
    let seen: Vec<bool> = equations.rows.iter().map(|row| row.a[0] > 0.0).collect();
    equations.regularise(&low.texture, terms.smoothness);
    let TexelGrid { size, texels, covered, .. } = &mut low.texture;
    terms.coarse.iter().for_each(|coarse| coarse.add_change(texels, *size));
    conjugate_gradients(&equations, texels, terms.iterations, cancellation);
    for texel in texels.iter_mut() {
        *texel = texel.clamp(Vec4::ZERO, Vec4::ONE).with_w(1.0);
    }
    let known: Vec<bool> = covered.iter().zip(seen).map(|(covered, seen)| *covered || seen).collect();
    fill_unknown(texels, &known, *size);
}
