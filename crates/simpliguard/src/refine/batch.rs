//! The views of one optimisation step.

use super::backend::BATCH;
use super::view_order::ViewOrder;

/// The views of a step, in random order from step to step.
pub(super) struct Batch {
    /// Indices of the views.
    pub(super) views: [usize; BATCH],
    order: ViewOrder,
}

impl Batch {
    /// A batch out of `views` views, in the order that `seed` gives.
    pub(super) fn new(views: usize, seed: u64) -> Self {
        Self { views: [0; BATCH], order: ViewOrder::new(views, seed) }
    }

    /// Chooses the views of the next step.
    pub(super) fn draw(&mut self) {
        self.views.iter_mut().for_each(|view| *view = self.order.next());
    }
}
