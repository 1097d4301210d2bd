//! The keys that show the panel and select levels.

use bevy::prelude::*;

use super::settings::OverlaySettings;
use crate::lod::LodSettings;

const BIASES: [f32; 4] = [1.0, 2.0, 4.0, 0.5];

/// Handles the keys.
pub(super) fn press(
    pressed: Res<'_, ButtonInput<KeyCode>>,
    mut overlay: ResMut<'_, OverlaySettings>,
    mut lods: ResMut<'_, LodSettings>,
) {
    let is_pressed = |key: Option<KeyCode>| key.is_some_and(|key| pressed.just_pressed(key));
    if is_pressed(overlay.keys.toggle) {
        overlay.visible = !overlay.visible;
    }
    if !overlay.visible {
        return;
    }
    let keys = &overlay.keys;
    if let Some((level, _)) = (0..).zip(&keys.levels).find(|(_, key)| pressed.just_pressed(**key)) {
        lods.force = Some(level);
    }
    if is_pressed(keys.automatic) {
        lods.force = None;
    }
    if is_pressed(keys.enabled) {
        lods.enabled = !lods.enabled;
    }
    if is_pressed(keys.bias) {
        let at = BIASES.iter().position(|bias| *bias == lods.bias).unwrap_or(0);
        lods.bias = BIASES[(at + 1) % BIASES.len()];
    }
}
