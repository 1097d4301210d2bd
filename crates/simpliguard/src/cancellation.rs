//! The flag that stops a bake.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::Error;

/// A flag that the caller sets and the bake reads, between stages and within them.
///
/// A loop may end early once the flag is set. Its result is then sound but unfinished, so the stage around it calls
/// [`Self::check`] before it uses the result.
#[derive(Clone, Debug, Default)]
pub struct Cancellation(Arc<AtomicBool>);

impl Cancellation {
    /// Asks every bake that holds this flag to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// True once [`Self::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Stops the bake of `asset` once the flag is set.
    ///
    /// # Errors
    /// [`Error::Cancelled`] once [`Self::cancel`] was called.
    pub fn check(&self, asset: &str) -> Result<(), Error> {
        if self.is_cancelled() { Err(Error::Cancelled { asset: asset.to_owned() }) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clone_sees_the_flag_and_the_error_names_the_asset() {
        let flag = Cancellation::default();
        let seen = flag.clone();
        assert!(seen.check("tree.glb").is_ok());
        flag.cancel();
        assert!(seen.is_cancelled());
        assert_eq!(seen.check("tree.glb").expect_err("cancelled").to_string(), "tree.glb: cancelled");
    }
}
