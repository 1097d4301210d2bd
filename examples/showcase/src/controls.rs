//! The keys that decide which level is shown.

use bevy::prelude::*;
use bevy_simpliguard::LodSettings;

use crate::clips::ClipChoice;

/// What the visitor chose.
#[derive(Resource, Default)]
pub(crate) struct Choice {
    /// The level that every model shows: 0 the source, `k` LOD k; `None` leaves it to the distance.
    pub(crate) forced: Option<u32>,
}

/// Keys and what they do, as the help shows them.
pub(crate) const KEYS: [(&str, &str); 11] = [
    ("0", "force the source"),
    ("1 .. 8", "force LOD 1 .. 8"),
    ("A, Esc", "levels by distance"),
    ("B", "bias: 1, 2, 4, 1/2"),
    ("L", "levels on and off"),
    ("C", "next clip"),
    ("Tab", "next view"),
    ("arrows, drag", "turn the camera"),
    ("right drag", "move the camera"),
    ("wheel, PgUp, PgDn", "zoom"),
    ("H", "hide or show this"),
];

const DIGITS: [KeyCode; 9] = [
    KeyCode::Digit0,
    KeyCode::Digit1,
    KeyCode::Digit2,
    KeyCode::Digit3,
    KeyCode::Digit4,
    KeyCode::Digit5,
    KeyCode::Digit6,
    KeyCode::Digit7,
    KeyCode::Digit8,
];

const BIASES: [f32; 4] = [1.0, 2.0, 4.0, 0.5];

pub(crate) fn plugin(app: &mut App) {
    app.init_resource::<Choice>().add_systems(Update, (force, adjust, next_clip));
}

fn force(keys: Res<ButtonInput<KeyCode>>, mut choice: ResMut<Choice>) {
    if keys.any_just_pressed([KeyCode::KeyA, KeyCode::Escape]) {
        choice.forced = None;
    }
    for (level, key) in (0..).zip(DIGITS) {
        if keys.just_pressed(key) {
            choice.forced = Some(level);
        }
    }
}

fn adjust(keys: Res<ButtonInput<KeyCode>>, mut settings: ResMut<LodSettings>) {
    if keys.just_pressed(KeyCode::KeyL) {
        settings.enabled = !settings.enabled;
    }
    if keys.just_pressed(KeyCode::KeyB) {
        let at = BIASES.iter().position(|bias| *bias == settings.bias).unwrap_or(0);
        settings.bias = BIASES[(at + 1) % BIASES.len()];
    }
}

fn next_clip(keys: Res<ButtonInput<KeyCode>>, mut clip: ResMut<ClipChoice>) {
    if keys.just_pressed(KeyCode::KeyC) {
        clip.0 += 1;
    }
}
