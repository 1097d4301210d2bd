//! The program around the bake of an object, which is a part of the bake of its scene.

use crate::host::{Host, Notice};

/// Passes everything on to the program around the scene, which has begun already.
pub(crate) struct ObjectHost<'a, H>(pub(crate) &'a H);

impl<H: Host> Host for ObjectHost<'_, H> {
    fn compute<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.0.compute(work)
    }

    fn store(&self, work: impl FnOnce()) {
        self.0.store(work);
    }

    fn notify(&self, notice: Notice) {
        self.0.notify(notice);
    }
}
