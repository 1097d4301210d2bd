//! Losses of the optimisation, each with its gradient.

mod distance;
mod image;
mod regularisation;

pub(super) use distance::SourceDistance;
pub(super) use image::{ImageLoss, squared_error, squared_error_of_means};
pub(super) use regularisation::Regularisation;
