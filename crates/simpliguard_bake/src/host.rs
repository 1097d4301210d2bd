//! The program around a cached bake.

use simpliguard::Error;
use simpliguard_cache::StorageError;

/// An event on the way to a result, for a line of the log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Notice {
    /// Another thread or process bakes the same model with the same settings; this one waits for it.
    #[error("another program is baking it; waiting")]
    Waits,
    /// The cache or its shared tier failed. The bake goes on without.
    #[error(transparent)]
    Storage(#[from] StorageError),
    /// The result cannot be stored. The bake goes on without.
    #[error("the result is not kept: {0}")]
    NotKept(Box<dyn std::error::Error + Send + Sync>),
    /// No process can be started for the bake. It goes on in this one.
    #[error("it is baked in this process, because no process of its own can be started: {0}")]
    NotIsolated(std::io::Error),
    /// The GPU that was asked for cannot be used.
    #[error("levels are refined on the CPU: {0}")]
    NoDevice(String),
    /// A line of the process that bakes.
    #[error("{text}")]
    OfChild {
        /// The line.
        text: String,
        /// See [`Notice::is_warning`].
        is_warning: bool,
    },
}

impl Notice {
    /// Tells whether something is wrong that the user can mend.
    pub fn is_warning(&self) -> bool {
        match self {
            Self::Waits => false,
            Self::OfChild { is_warning, .. } => *is_warning,
            Self::Storage(_) | Self::NotKept(_) | Self::NotIsolated(_) | Self::NoDevice(_) => true,
        }
    }
}

impl From<simpliguard_cache::Notice> for Notice {
    fn from(notice: simpliguard_cache::Notice) -> Self {
        match notice {
            simpliguard_cache::Notice::Waits => Self::Waits,
            simpliguard_cache::Notice::Shared(error) => Self::Storage(error),
            simpliguard_cache::Notice::NotKept(error) => Self::NotKept(error.into()),
        }
    }
}

/// The program around a cached bake: its threads, its messages and its shutdown.
pub trait Host {
    /// Called when the result is nowhere to be found, before the bake begins. An error ends the bake.
    ///
    /// # Errors
    /// Those of the program.
    fn begin(&self) -> Result<(), Error> {
        Ok(())
    }

    /// Runs the bake where the program computes, such as in its rayon pool. By default on the calling thread.
    fn compute<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        work()
    }

    /// Stores the result. A program that may be interrupted waits until `work` has returned.
    fn store(&self, work: impl FnOnce()) {
        work();
    }

    /// Takes an event. Called on the thread that runs the cached bake.
    fn notify(&self, notice: Notice);

    /// Told of each object of a scene that has its levels, and whether the cache had them.
    fn object(&self, _name: &str, _is_cached: bool) {}
}
