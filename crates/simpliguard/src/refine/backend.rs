//! The seam between the optimisation and the device that renders for it.
//!
//! The optimisation needs pictures of a level for three things: the gradient of a step, the score by the views held out, and
//! the texture that fits the views best. A [`Backend`] does these, and everything else is the same for all of them.
//! [`super::Cpu`] is the one of this crate.

use glam::{Vec3, Vec4};

use super::covered_views::CoveredViews;
use super::low_poly::LowPoly;
use super::texture_least_squares::LeastSquares;
use crate::Cancellation;

/// Views a step.
pub const BATCH: usize = 2;

/// An error of a device. The level is then refined on another one, from its start.
pub type DeviceError = Box<dyn std::error::Error + Send + Sync>;

/// A device that may fail at any time.
pub type Device = dyn Backend<Error = DeviceError>;

/// A device that refines levels.
pub trait Backend: Sync {
    /// The reason why it cannot go on.
    type Error;

    /// Its name, for reports.
    fn name(&self) -> &str;

    /// It has the memory for views and for a texture of these sides, in pixels and in texels.
    fn can_hold(&self, view: usize, texture: usize) -> bool;

    /// Takes what stays the same for many steps: the views, and the triangles, texture coordinates and texture size of a
    /// level.
    ///
    /// # Errors
    /// If the device fails, or cannot hold them.
    fn open<'a>(
        &'a self,
        low: &LowPoly,
        views: CoveredViews<'a>,
        cancellation: &'a Cancellation,
    ) -> Result<Box<dyn LevelRenderer<Error = Self::Error> + 'a>, Self::Error>;
}

/// Renders one level to compare it with its views.
///
/// Every method takes the level as it is now. Its vertices, motions and texels may have changed since the last call.
pub trait LevelRenderer {
    /// The reason why it cannot go on.
    type Error;

    /// Replaces `gradients` by those of the image losses of some views, which must be antialiased.
    ///
    /// # Errors
    /// If the device fails.
    fn differentiate(
        &mut self,
        low: &LowPoly,
        views: [usize; BATCH],
        loss: LossTerms,
        gradients: &mut [ViewGradient; BATCH],
    ) -> Result<(), Self::Error>;

    /// The mean squared error of the colours in each view, 0 to 1, over white and over black; of fewer views if cancelled.
    ///
    /// # Errors
    /// If the device fails.
    fn errors(&mut self, low: &LowPoly) -> Result<Vec<f64>, Self::Error>;

    /// Replaces the texture of `low` by the one that fits the views best, starting from the present one. Ends early if
    /// cancelled.
    ///
    /// # Errors
    /// If the device fails. The texture is then as it was.
    fn solve_texture(&mut self, low: &mut LowPoly, terms: LeastSquares<'_>) -> Result<(), Self::Error>;

    /// Draws a view alone, to compare devices.
    ///
    /// # Errors
    /// If the device fails.
    fn draw(&mut self, low: &LowPoly, view: usize) -> Result<Drawing, Self::Error>;
}

/// Terms of the image loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossTerms {
    /// Encoded grey behind the level and the source, 0 to 1.
    pub background: f32,
    /// Weight of the image gradient.
    pub gradient_weight: f32,
}

/// The gradient of the image loss of one view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewGradient {
    /// The loss, per pixel.
    pub loss: f64,
    /// At the vertices in world space, in the pose of the view.
    pub posed: Vec<Vec3>,
    /// At the vertices in world space, in the rest pose.
    pub positions: Vec<Vec3>,
}

/// A view of a level, rows from the bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// Visible triangle of each pixel, or [`EMPTY_PIXEL`](crate::render::EMPTY_PIXEL).
    pub ids: Vec<u32>,
    /// Antialiased colour of each pixel: sRGB encoded, premultiplied.
    pub colors: Vec<Vec4>,
}
