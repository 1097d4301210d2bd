//! A panel on the screen. It shows the number of triangles and draw calls, drawn and of the sources, the number of instances
//! of each level, the frame time, the memory of sources and levels, and the bakes. Keys force a level. Feature `overlay`.
//!
//! ```no_run
//! use bevy::asset::AssetMode;
//! use bevy::prelude::*;
//! use bevy_simpliguard::{OverlayPlugin, SimpliguardPlugin};
//!
//! App::new().add_plugins((
//!     SimpliguardPlugin::default(),
//!     DefaultPlugins.set(AssetPlugin { mode: AssetMode::Processed, ..default() }),
//!     OverlayPlugin::default(),
//! ));
//! ```
//!
//! The panel uses Bevy's UI and its built-in font, and loads no asset. A hidden panel has no entities, and one system
//! that waits for its key. Without the feature `bake` it shows everything except bakes.

#[cfg(feature = "bake")]
mod bakes;
mod figures;
mod keys;
mod levels;
mod memory;
mod panel;
mod settings;
mod style;
#[cfg(test)]
mod tests;

use std::time::Duration;

use bevy::prelude::*;
use bevy::time::common_conditions::on_timer;

pub use self::figures::thousands;
pub use self::levels::{LEVELS, level_color};
use self::settings::is_visible;
pub use self::settings::{OverlayCorner, OverlayKeys, OverlaySettings};
use crate::lod::{LodSettings, LodStats};

/// Time between two counts of memory: it changes when models are loaded.
const MEMORY_INTERVAL: Duration = Duration::from_millis(500);

/// Shows the panel. It may be added before or after the other plugins.
#[derive(Clone, Debug, Default)]
pub struct OverlayPlugin {
    /// The first value of the resource [`OverlaySettings`].
    pub settings: OverlaySettings,
}

impl Plugin for OverlayPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(self.settings.clone())
            .register_type::<OverlaySettings>()
            .init_resource::<LodSettings>()
            .init_resource::<LodStats>()
            .init_resource::<ButtonInput<KeyCode>>()
            .add_systems(
                Update,
                (
                    keys::press,
                    panel::rebuild.run_if(resource_changed::<OverlaySettings>),
                    (figures::figures, figures::legend, figures::mode).run_if(is_visible),
                )
                    .chain(),
            );
        app.add_systems(
            Update,
            memory::memory.run_if(on_timer(MEMORY_INTERVAL)).run_if(is_visible).after(panel::rebuild),
        );
        #[cfg(feature = "bake")]
        app.add_systems(Update, bakes::list.run_if(is_visible).after(panel::rebuild));
    }
}
