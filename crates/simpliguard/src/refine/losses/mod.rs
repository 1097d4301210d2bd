//! Losses of the optimisation, each with its gradient.

mod distance;
mod image;
mod regularisation;

pub(super) use distance::SourceDistance;
pub(super) use image::{ImageLoss, squared_error};
pub(super) use regularisation::Regularisation;
