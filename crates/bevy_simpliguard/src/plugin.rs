//! The plugin.

use std::path::PathBuf;
use std::time::Duration;

use bevy::prelude::*;

use crate::lod::{LodPlugin, LodSettings};
use crate::options::{BakeBackend, BakeMode, BakePriority};

/// Bakes levels of detail when models are imported, and switches them while the game runs. Add it before
/// `DefaultPlugins`, and set `AssetMode::Processed`:
///
/// ```no_run
/// use bevy::prelude::*;
/// use bevy_simpliguard::SimpliguardPlugin;
///
/// App::new().add_plugins((
///     SimpliguardPlugin::default(),
///     DefaultPlugins.set(AssetPlugin { mode: AssetMode::Processed, ..default() }),
/// ));
/// ```
///
/// Without the feature `bake` nothing is baked, and only `lods`, `mipmaps` and `anisotropy` have an
/// effect.
#[derive(Clone, Debug)]
pub struct SimpliguardPlugin {
    /// The first value of the resource [`LodSettings`].
    pub lods: LodSettings,
    /// True if the textures of levels and of their source get mipmaps; see [`LodPlugin::mipmaps`]. On by default.
    pub mipmaps: bool,
    /// Largest anisotropy of the filter of mipmaps; see [`LodPlugin::anisotropy`].
    pub anisotropy: Option<u16>,
    /// Overrides `plugin.mode` of `config/simpliguard.ron`.
    pub mode: Option<BakeMode>,
    /// A profile of `config/simpliguard.ron`.
    pub profile: Option<String>,
    /// Folder of the cache. Overrides the environment and `config/simpliguard.ron`.
    pub cache_dir: Option<PathBuf>,
    /// Number of threads that bake. Overrides `plugin.threads` of `config/simpliguard.ron`. By default one less than
    /// the cores, and all cores in [`BakeMode::Blocking`].
    pub threads: Option<usize>,
    /// Overrides `plugin.priority` of `config/simpliguard.ron`.
    pub priority: Option<BakePriority>,
    /// Memory in bytes that one bake may take; half of the machine's by default. A model that would take more fails before
    /// anything is allocated for it.
    pub memory: Option<u64>,
    /// Overrides `plugin.isolate` of `config/simpliguard.ron`: each bake runs in a process of its own, so that a crash or a lack
    /// of memory costs one model and not the game. For that the game starts itself once more; this plugin bakes and ends that
    /// process as soon as it is added. So whatever `main` does before runs there too.
    pub isolate: Option<bool>,
    /// Overrides `backend` of `config/simpliguard.ron`. A GPU needs the feature `gpu`, which is on by default.
    pub backend: Option<BakeBackend>,
    /// Most work of a GPU for bakes in each frame, that is, in each sixtieth of a second. Overrides
    /// `plugin.gpu_ms_per_frame` of `config/simpliguard.ron`. By default 4 milliseconds, and no limit in
    /// [`BakeMode::Blocking`]; a tenth of a millisecond at least.
    pub gpu_time: Option<Duration>,
}

impl Default for SimpliguardPlugin {
    fn default() -> Self {
        let LodPlugin { settings: lods, mipmaps, anisotropy } = LodPlugin::default();
        Self {
            lods,
            mipmaps,
            anisotropy,
            mode: None,
            profile: None,
            cache_dir: None,
            threads: None,
            priority: None,
            memory: None,
            isolate: None,
            backend: None,
            gpu_time: None,
        }
    }
}

#[cfg(feature = "bake")]
impl SimpliguardPlugin {
    fn bake_options(&self) -> crate::options::BakeOptions {
        let Self { mode, threads, priority, memory, isolate, backend, gpu_time, .. } = *self;
        let (profile, cache_dir) = (self.profile.clone(), self.cache_dir.clone());
        crate::options::BakeOptions { mode, profile, cache_dir, threads, priority, memory, isolate, backend, gpu_time }
    }
}

impl Plugin for SimpliguardPlugin {
    fn build(&self, app: &mut App) {
        let Self { mipmaps, anisotropy, .. } = *self;
        app.add_plugins(LodPlugin { settings: self.lods.clone(), mipmaps, anisotropy });
        #[cfg(feature = "bake")]
        crate::bake::build(&self.bake_options(), app);
    }

    #[cfg(feature = "bake")]
    fn finish(&self, app: &mut App) {
        crate::bake::finish(&self.bake_options(), app);
    }

    #[cfg(feature = "bake")]
    fn cleanup(&self, app: &mut App) {
        crate::bake::cleanup(app);
    }
}
