//! A panel on the screen that shows the levels at work: triangles drawn against those of the sources, how many instances show
//! each level, the frame time, and what is being baked. Keys force a level. Feature `overlay`.
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
//! It draws with Bevy's UI and its built-in font and loads no asset. Hidden, it has no entity and runs one system, which
//! waits for its key. Without the feature `bake` it shows everything but bakes.

#[cfg(feature = "bake")]
mod bakes;
mod figures;
mod keys;
mod panel;
#[cfg(test)]
mod tests;

use bevy::prelude::*;

pub use self::figures::thousands;
use crate::lod::{LodSettings, LodStats};

/// Highest level number that a file may have.
pub const LEVELS: u32 = 8;

/// Shows the panel. It may be added before or after the other plugins.
#[derive(Clone, Debug, Default)]
pub struct OverlayPlugin {
    /// The first value of the resource [`OverlaySettings`].
    pub settings: OverlaySettings,
}

/// How the panel looks and what its keys are. May change at any time.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct OverlaySettings {
    /// Whether the panel is on the screen.
    pub visible: bool,
    /// Where it is.
    pub corner: OverlayCorner,
    /// Size of its text in logical pixels, above 0.
    pub text_size: f32,
    /// What its keys are.
    pub keys: OverlayKeys,
}

impl Default for OverlaySettings {
    fn default() -> Self {
        Self { visible: true, corner: OverlayCorner::default(), text_size: 14.0, keys: OverlayKeys::default() }
    }
}

/// A corner of the window.
#[derive(Reflect, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[reflect(Default, Clone, PartialEq)]
pub enum OverlayCorner {
    /// Top left.
    #[default]
    TopLeft,
    /// Top right.
    TopRight,
    /// Bottom left.
    BottomLeft,
    /// Bottom right.
    BottomRight,
}

/// The keys of the panel; all but [`toggle`](Self::toggle) work only while it is shown, so that a game may use them too.
/// They write [`LodSettings`], which keeps what was chosen when the panel is hidden.
#[derive(Reflect, Clone, Debug, PartialEq, Eq)]
#[reflect(Default, Clone, PartialEq)]
pub struct OverlayKeys {
    /// Shows and hides the panel. `F3` by default.
    pub toggle: Option<KeyCode>,
    /// Force a level everywhere; the place in the list is the level's number, 0 for the source. `0` to `8` by default.
    pub levels: Vec<KeyCode>,
    /// Leaves levels to the distance again. `A` by default.
    pub automatic: Option<KeyCode>,
    /// Turns levels on and off. `L` by default.
    pub enabled: Option<KeyCode>,
    /// Goes through the biases 1, 2, 4 and 1/2. `B` by default.
    pub bias: Option<KeyCode>,
}

impl Default for OverlayKeys {
    fn default() -> Self {
        Self {
            toggle: Some(KeyCode::F3),
            levels: vec![
                KeyCode::Digit0,
                KeyCode::Digit1,
                KeyCode::Digit2,
                KeyCode::Digit3,
                KeyCode::Digit4,
                KeyCode::Digit5,
                KeyCode::Digit6,
                KeyCode::Digit7,
                KeyCode::Digit8,
            ],
            automatic: Some(KeyCode::KeyA),
            enabled: Some(KeyCode::KeyL),
            bias: Some(KeyCode::KeyB),
        }
    }
}

/// The colour that stands for a level; of the source, number 0, a light grey.
pub fn level_color(level: u32) -> Color {
    const COLORS: [Color; LEVELS as usize + 1] = [
        Color::srgb(0.93, 0.93, 0.91),
        Color::srgb(0.84, 0.27, 0.19),
        Color::srgb(0.94, 0.65, 0.16),
        Color::srgb(0.18, 0.62, 0.45),
        Color::srgb(0.22, 0.55, 0.79),
        Color::srgb(0.46, 0.36, 0.71),
        Color::srgb(0.80, 0.47, 0.65),
        Color::srgb(0.45, 0.33, 0.24),
        Color::srgb(0.35, 0.40, 0.45),
    ];
    COLORS[level.min(LEVELS) as usize]
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
        #[cfg(feature = "bake")]
        bakes::build(app);
    }
}

fn is_visible(settings: Res<'_, OverlaySettings>) -> bool {
    settings.visible
}
