use crate::geometry::Random;

/// Views in random order, each once before any comes again.
pub(super) struct ViewOrder {
    random: Random,
    views: Vec<usize>,
    at: usize,
}

impl ViewOrder {
    pub(super) fn new(views: usize, seed: u64) -> Self {
        Self { random: Random::new(seed), views: (0..views).collect(), at: views }
    }

    /// Index of the next view. There must be at least one view.
    pub(super) fn next(&mut self) -> usize {
        if self.at == self.views.len() {
            for i in (1..self.views.len()).rev() {
                self.views.swap(i, (self.random.bits() % (i as u64 + 1)) as usize);
            }
            self.at = 0;
        }
        self.at += 1;
        self.views[self.at - 1]
    }
}
