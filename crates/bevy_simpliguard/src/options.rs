//! Options of the plugin that decide when and how fast a game bakes.

#[cfg(feature = "bake")]
use std::path::PathBuf;
#[cfg(feature = "bake")]
use std::time::Duration;

/// Time at which the levels of a model appear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakeMode {
    /// Models appear at once as they are. Their levels are swapped in when they are done.
    #[default]
    Progressive,
    /// A model appears when its levels are done. This is for builds and automatic tests.
    Blocking,
}

/// Priority of bakes on cores that the game wants too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakePriority {
    /// Bakes take the time that the game leaves. On cores that the game uses all the time, this is next to nothing: a
    /// game that never waits for its display may not get its levels for an hour.
    Lowest,
    /// Bakes get about a tenth of such cores. The default of [`BakeMode::Progressive`].
    #[default]
    Low,
    /// Bakes get as much as the game. The default of [`BakeMode::Blocking`], where the game waits for them.
    Normal,
}

/// The processor that refines levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakeBackend {
    /// A GPU, if the machine has one, else the CPU.
    Auto,
    /// The CPU. It gives the same bytes on every machine.
    #[default]
    Cpu,
    /// A GPU, and the CPU with a warning if there is none.
    Gpu,
}

/// The options of the plugin that concern baking. `None` leaves a value to `config/simpliguard.ron`.
#[cfg(feature = "bake")]
#[derive(Clone, Debug, Default)]
pub(crate) struct BakeOptions {
    pub(crate) mode: Option<BakeMode>,
    /// A profile of `config/simpliguard.ron`.
    pub(crate) profile: Option<String>,
    /// Folder of the cache.
    pub(crate) cache_dir: Option<PathBuf>,
    /// Number of threads that bake.
    pub(crate) threads: Option<usize>,
    pub(crate) priority: Option<BakePriority>,
    /// Memory in bytes that one bake may take.
    pub(crate) memory: Option<u64>,
    /// True if each bake runs in a process of its own.
    pub(crate) isolate: Option<bool>,
    pub(crate) backend: Option<BakeBackend>,
    /// Most work of a GPU in each frame.
    pub(crate) gpu_time: Option<Duration>,
}
