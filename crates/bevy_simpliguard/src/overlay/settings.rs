//! Settings of the panel.

use bevy::prelude::*;

/// Look and keys of the panel. They may change at any time.
#[derive(Resource, Reflect, Clone, Debug, PartialEq)]
#[reflect(Resource, Default, Clone, PartialEq)]
pub struct OverlaySettings {
    /// True if the panel is on the screen.
    pub visible: bool,
    /// Position of the panel.
    pub corner: OverlayCorner,
    /// Size of the text in logical pixels, above 0.
    pub text_size: f32,
    /// Keys of the panel.
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

/// The keys of the panel. All except [`toggle`](Self::toggle) work only while the panel is shown, so a game may use
/// them too. They write [`LodSettings`](crate::lod::LodSettings), which keeps its values when the panel is hidden.
#[derive(Reflect, Clone, Debug, PartialEq, Eq)]
#[reflect(Default, Clone, PartialEq)]
pub struct OverlayKeys {
    /// Shows and hides the panel. `F3` by default.
    pub toggle: Option<KeyCode>,
    /// Each key forces a level everywhere. Its index is the number of the level, 0 for the source. `0` to `8` by
    /// default.
    pub levels: Vec<KeyCode>,
    /// Selects levels by distance again. `A` by default.
    pub automatic: Option<KeyCode>,
    /// Turns levels on and off. `L` by default.
    pub enabled: Option<KeyCode>,
    /// Steps through the biases 1, 2, 4 and 1/2. `B` by default.
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

/// Tells whether the panel is shown.
pub(super) fn is_visible(settings: Res<'_, OverlaySettings>) -> bool {
    settings.visible
}
