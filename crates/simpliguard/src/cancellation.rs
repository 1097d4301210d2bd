//! The flag that ends a bake.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::Error;

/// A flag shared between the one who cancels and the bake, which looks at it between and within stages.
///
/// A loop that holds it ends early once it is set, and what it returns then is sound but unfinished; the stage around it
/// asks [`Context::check`] before it uses that.
#[derive(Clone, Debug, Default)]
pub struct Cancellation(Arc<AtomicBool>);

impl Cancellation {
    /// Asks every bake that holds this flag to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`Self::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// `Err` once the bake of `asset` is cancelled.
    pub fn check(&self, asset: &str) -> Result<(), Error> {
        if self.is_cancelled() { Err(Error::Cancelled { asset: asset.to_owned() }) } else { Ok(()) }
    }
}
