//! Parameters of the stage.

use serde::Serialize;

/// How a level is refined.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RefineParams {
    /// Vertex steps. Zero fits the texture alone.
    pub steps: u32,
    /// Fraction of the steps, the first ones, that compare views of half the resolution.
    pub coarse: f32,
    /// Length of the first step, as a fraction of the mean edge.
    pub step_length: f32,
    /// How the texture is fitted; `None` leaves it as it is.
    pub texture: Option<TextureFit>,
    /// Weight of the image gradient in the image loss.
    pub gradient_weight: f32,
    /// Weight of the Laplacian of the displacement. The unit of length is the radius of the source's bounding sphere.
    pub laplacian_weight: f32,
    /// The Laplacian is that of the positions.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub laplacian_of_positions: bool,
    /// Weight of the squared distance to the source. The unit of length is the mean edge.
    pub distance_weight: f32,
    /// Weight of the consistency of vertex normals.
    pub normal_weight: f32,
}

/// How a texture is fitted to the views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TextureFit {
    /// Weight of the squared differences of neighbouring texels, in pixels.
    pub smoothness: f32,
    /// Difference of colours, 0 to 1, at which a pixel counts half: it is likely to show another surface of the source.
    /// `None` counts all pixels alike. For least squares.
    pub trust: Option<f32>,
    /// The algorithm.
    pub solver: Solver,
}

/// Algorithms that fit a texture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Solver {
    /// One linear least-squares problem over all views.
    LeastSquares,
    /// Gradient descent by Adam, as in the paper.
    Adam(TextureAdam),
}

/// How a texture is optimised by Adam.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TextureAdam {
    /// Steps of two views.
    pub steps: u32,
    /// Weight of the image gradient in the image loss.
    pub gradient_weight: f32,
    /// Standard deviation in texels of random perturbations that the smoothness compares; 0 compares neighbours.
    pub perturbation: f32,
}
