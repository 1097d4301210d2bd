//! Buffers that threads take in turn.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Values that threads use in turn; there are as many as are used at the same time. Rayon's `map_init` makes one for each
/// piece of work, and the buffers of a picture are large.
#[derive(Debug)]
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Pool<T> {
    /// An empty pool.
    pub(crate) fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Calls `f` with a value that no other thread has meanwhile: one that is idle, as its last user left it, or a new one.
    pub(crate) fn with<R>(&self, make: impl FnOnce() -> T, f: impl FnOnce(&mut T) -> R) -> R {
        let idle = self.idle().pop();
        let mut value = idle.unwrap_or_else(make);
        let result = f(&mut value);
        self.idle().push(value);
        result
    }

    fn idle(&self) -> MutexGuard<'_, Vec<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_used_again_once_it_is_idle() {
        let (pool, made) = (Pool::new(), std::cell::Cell::new(0));
        let make = || {
            made.set(made.get() + 1);
            made.get()
        };
        assert_eq!(pool.with(make, |first| (*first, pool.with(make, |second| *second))), (1, 2));
        assert_eq!(made.get(), 2, "both are in use");
        pool.with(make, |idle| *idle = 7);
        assert_eq!((pool.with(make, |idle| *idle), made.get()), (7, 2));
    }
}
