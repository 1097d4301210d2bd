use super::coarse_solution::CoarseSolution;

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
    /// That of [`TextureFit`](crate::refine::TextureFit).
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
    pub(in crate::refine) fn halved(&self) -> Self {
        Self { pixel_stride: COARSE_STRIDE, smoothness: self.smoothness.max(COARSE_SMOOTHNESS), ..*self }
    }

    /// The same from a coarse solution on.
    pub(in crate::refine) fn nested(self, coarse: &'a CoarseSolution) -> Self {
        Self { iterations: NESTED_ITERATIONS, coarse: Some(coarse), ..self }
    }
}
