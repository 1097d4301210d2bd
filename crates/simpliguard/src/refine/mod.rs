//! Differentiable rendering: texture by least squares, vertices by gradient descent (paper 3.4).
//!
//! The level is rendered with analytic antialiasing (`forward`), compared with the source's pictures (`image_loss`), and
//! the error is carried back to the vertices (`backward`). For fixed vertices the texture that fits the pictures best
//! is a linear problem: bilinear sampling couples a texel with its eight neighbours only, so its normal equations are a
//! nine-point stencil whatever the number of views (`texture_least_squares`). The paper's descent on the texture (`texture_adam`) is
//! there to compare with.
//!
//! Colours are sRGB encoded here: errors then weigh as they are seen.

mod backward;
mod constraints;
mod distance;
mod forward;
#[cfg(test)]
mod gradient_tests;
mod image_loss;
mod low_poly;
mod optimise;
mod optimizer;
mod regularisation;
mod skin;
mod texture_adam;
mod texture_least_squares;
mod train_validation;

pub use low_poly::LowPoly;
pub use optimise::{RefineParams, Refined, ViewTarget, fit_texture, refine};
pub use skin::Skin;
pub use texture_adam::{TextureAdam, optimise_texture};
pub use texture_least_squares::solve_texture;

/// How a texture is fitted to the views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureFit {
    /// Weight of the squared differences of neighbouring texels, in pixels.
    pub smoothness: f32,
    /// Difference of colours, 0 to 1, at which a pixel counts half, since it is likely to show another part of the source;
    /// `None` counts all alike. For least squares.
    pub trust: Option<f32>,
    /// By what.
    pub solver: Solver,
}

/// What fits a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solver {
    /// [`solve_texture`].
    LeastSquares,
    /// [`optimise_texture`].
    Adam(TextureAdam),
}
