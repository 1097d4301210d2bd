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
mod terms;

use glam::Vec4;

use self::assemble::assemble;
pub use self::coarse_solution::CoarseSolution;
use self::conjugate_gradients::conjugate_gradients;
pub use self::terms::LeastSquares;
use super::covered_views::CoveredViews;
use super::low_poly::{LowPoly, TexelGrid};
use crate::Cancellation;
use crate::render::fill_unknown;

/// Replaces the texture of `low` by the one that fits `views` best, starting from the present one.
pub(super) fn solve_texture(
    low: &mut LowPoly,
    views: &CoveredViews<'_>,
    terms: LeastSquares<'_>,
    cancellation: &Cancellation,
) {
    let mut equations = assemble(low, views, terms, cancellation);
    let seen: Vec<bool> = equations.rows.iter().map(|row| row.a.x > 0.0).collect();
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
