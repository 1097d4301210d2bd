//! Differentiable rendering: texture by least squares, vertices by gradient descent (paper 3.4).
//!
//! The level is rendered with analytic antialiasing (`forward`), compared with the source's pictures (`loss`), and
//! the error is carried back to the vertices (`backward`). For fixed vertices the texture that fits the pictures best
//! is a linear problem: bilinear sampling couples a texel with its eight neighbours only, so its normal equations are a
//! nine-point stencil whatever the number of views (`stencil`).
//!
//! Colours are sRGB encoded here: errors then weigh as they are seen.

mod adam;
mod backward;
mod descent;
mod distance;
mod forward;
#[cfg(test)]
mod gradient_tests;
mod guard;
mod loss;
mod low_poly;
mod regularise;
mod skin;
mod stencil;

pub use descent::{Params, Refined, fit_texture, refine};
pub use low_poly::LowPoly;
pub use skin::Skin;
pub use stencil::solve_texture;
