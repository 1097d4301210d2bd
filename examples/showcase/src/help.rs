//! The keys, in the corner below the panel.

use bevy::prelude::*;

/// Keys and what they do. Those that choose levels are the panel's.
const KEYS: [(&str, &str); 12] = [
    ("0", "force the source"),
    ("1 .. 8", "force LOD 1 .. 8"),
    ("A", "levels by distance"),
    ("B", "bias: 1, 2, 4, 1/2"),
    ("L", "levels on and off"),
    ("C", "next clip"),
    ("Tab", "next view"),
    ("arrows, drag", "turn the camera"),
    ("right drag", "move the camera"),
    ("wheel, PgUp, PgDn", "zoom"),
    ("F3", "hide or show the panel"),
    ("H", "hide or show this"),
];

#[derive(Component)]
pub(crate) struct Help;

pub(crate) fn plugin(app: &mut App) {
    app.add_systems(Startup, spawn).add_systems(Update, toggle);
}

fn spawn(mut commands: Commands) {
    let node = Node {
        position_type: PositionType::Absolute,
        left: px(14),
        bottom: px(14),
        padding: UiRect::axes(px(14), px(10)),
        column_gap: px(18),
        border_radius: BorderRadius::all(px(7)),
        ..default()
    };
    let column = |text: [&str; KEYS.len()], color| {
        (Text::new(text.join("\n")), TextFont::from_font_size(13.0), TextColor(color))
    };
    commands.spawn((
        Help,
        node,
        BackgroundColor(Color::srgba(0.10, 0.11, 0.12, 0.82)),
        children![
            column(KEYS.map(|(key, _)| key), Color::srgb(0.94, 0.94, 0.92)),
            column(KEYS.map(|(_, meaning)| meaning), Color::srgb(0.70, 0.71, 0.72)),
        ],
    ));
}

fn toggle(keys: Res<ButtonInput<KeyCode>>, mut help: Single<&mut Node, With<Help>>) {
    if keys.just_pressed(KeyCode::KeyH) {
        help.display = if help.display == Display::None { Display::Flex } else { Display::None };
    }
}
