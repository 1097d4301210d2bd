//! The plugin.

use std::path::PathBuf;

use bevy::prelude::*;

use crate::lod::{LodPlugin, LodSettings};

/// When the levels of a model appear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakeMode {
    /// Models appear at once as they are; their levels are swapped in when they are done.
    #[default]
    Progressive,
    /// A model appears when its levels are done: for builds and automatic tests.
    Blocking,
}

/// How bakes stand behind the game where both want the same cores.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BakePriority {
    /// They take what the game leaves; of cores that it uses all the time, next to nothing: a game that never waits for its
    /// display may not see its levels for an hour.
    Lowest,
    /// They get about a tenth of such cores. The default of [`BakeMode::Progressive`].
    #[default]
    Low,
    /// They get as much as the game. The default of [`BakeMode::Blocking`], where it waits for them.
    Normal,
}

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
/// Without the feature `bake` nothing is baked, and everything but the switching is without effect.
#[derive(Clone, Debug)]
pub struct SimpliguardPlugin {
    /// How levels are chosen at first.
    pub lods: LodSettings,
    /// Whether the textures of levels get mipmaps; see [`LodPlugin::mipmaps`]. On by default.
    pub mipmaps: bool,
    /// Overrides `plugin.mode` of `config/simpliguard.ron`.
    pub mode: Option<BakeMode>,
    /// A profile of `config/simpliguard.ron`.
    pub profile: Option<String>,
    /// Overrides every other place of the cache.
    pub cache_dir: Option<PathBuf>,
    /// Threads that bake; overrides `plugin.threads` of `config/simpliguard.ron`. By default one less than the cores, and all of
    /// them in [`BakeMode::Blocking`].
    pub threads: Option<usize>,
    /// Overrides `plugin.priority` of `config/simpliguard.ron`.
    pub priority: Option<BakePriority>,
}

impl Default for SimpliguardPlugin {
    fn default() -> Self {
        let LodPlugin { settings: lods, mipmaps } = LodPlugin::default();
        Self { lods, mipmaps, mode: None, profile: None, cache_dir: None, threads: None, priority: None }
    }
}

impl Plugin for SimpliguardPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(LodPlugin { settings: self.lods.clone(), mipmaps: self.mipmaps });
        #[cfg(feature = "bake")]
        crate::bake::build(self, app);
    }

    #[cfg(feature = "bake")]
    fn finish(&self, app: &mut App) {
        crate::bake::finish(self, app);
    }

    #[cfg(feature = "bake")]
    fn cleanup(&self, app: &mut App) {
        crate::bake::cleanup(app);
    }
}
