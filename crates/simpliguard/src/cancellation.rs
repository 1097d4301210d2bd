//! The flag that stops a bake.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::Error;

/// A flag that the caller sets and the bake reads, between stages and within them.
///
/// A loop may end early once the flag is set. Its result is then sound but unfinished, so the stage around it calls
/// [`Self::check`] before it uses the result.
#[derive(Clone, Debug, Default)]
pub struct Cancellation {
    flag: Arc<AtomicBool>,
    /// Another one that also stops whoever holds this.
    outer: Option<Arc<Cancellation>>,
}

impl Cancellation {
    /// A cancellation that is also set once another flag is. Setting it leaves this one as it is.
    #[must_use]
    pub fn or(&self, flag: Arc<AtomicBool>) -> Self {
        Self { flag, outer: Some(Arc::new(self.clone())) }
    }

    /// Asks every bake that holds this flag to stop.
    pub fn cancel(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }

    /// True once [`Self::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.flag.load(Ordering::Relaxed) || self.outer.as_ref().is_some_and(|outer| outer.is_cancelled())
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
    fn an_inner_one_is_set_by_its_flag_and_by_the_outer_one() {
        let outer = Cancellation::default();
        let (first, second) = (outer.or(Arc::default()), outer.or(Arc::default()));
        first.cancel();
        assert_eq!([&first, &second, &outer].map(Cancellation::is_cancelled), [true, false, false]);
        outer.cancel();
        assert!(second.is_cancelled());
    }

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
