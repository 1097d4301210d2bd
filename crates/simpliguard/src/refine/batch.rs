//! The views of one optimisation step.

use super::backward::Gradients;
use super::covered_views::CoveredViews;
use super::forward::FrameBuffers;
use super::losses::ImageLoss;
use super::view_order::ViewOrder;

/// Views a step.
pub(super) const BATCH: usize = 2;

/// Everything that one view of a batch needs, reused from step to step.
pub(super) struct BatchSlot {
    /// Index of the view.
    pub(super) view: usize,
    pub(super) frame: FrameBuffers,
    pub(super) loss: ImageLoss,
    pub(super) gradients: Gradients,
}

/// The slots of a batch, and the order in which views enter them.
pub(super) struct Batch {
    pub(super) slots: [BatchSlot; BATCH],
    order: ViewOrder,
}

impl Batch {
    /// A batch of views out of `views`, in the order that `seed` gives.
    pub(super) fn new(views: &CoveredViews<'_>, seed: u64) -> Self {
        let slot = |_| BatchSlot {
            view: 0,
            frame: FrameBuffers::new(views.size()),
            loss: ImageLoss::default(),
            gradients: Gradients::default(),
        };
        Self { slots: std::array::from_fn(slot), order: ViewOrder::new(views.len(), seed) }
    }

    /// Chooses the views of the next step.
    pub(super) fn draw(&mut self) {
        self.slots.iter_mut().for_each(|slot| slot.view = self.order.next());
    }
}
