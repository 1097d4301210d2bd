//! The entities of the panel. They exist only while the panel is shown.

use bevy::prelude::*;

#[cfg(feature = "bake")]
use super::bakes::BakeList;
use super::figures::{Figures, LegendEntry, Mode};
use super::levels::{LEVELS, level_color};
use super::memory::MemoryLines;
use super::settings::{OverlayCorner, OverlaySettings};
use super::style::{DIM, TEXT, text};

/// Above everything that a game shows, and below Bevy's own overlay.
const Z: i32 = i32::MAX - 64;

/// Distance from the edges of the window in logical pixels.
const MARGIN: f32 = 14.0;

/// The panel.
#[derive(Component)]
pub(super) struct Panel;

/// Removes the panel, and spawns it anew if it is visible.
pub(super) fn rebuild(
    mut commands: Commands<'_, '_>,
    settings: Res<'_, OverlaySettings>,
    panels: Query<'_, '_, Entity, With<Panel>>,
) {
    for panel in &panels {
        commands.entity(panel).despawn();
    }
    if settings.visible {
        spawn(&mut commands, &settings);
    }
}

fn spawn(commands: &mut Commands<'_, '_>, settings: &OverlaySettings) {
    let size = settings.text_size;
    let panel = Node {
        padding: UiRect::axes(px(size), px(0.7 * size)),
        row_gap: px(0.4 * size),
        flex_direction: FlexDirection::Column,
        border_radius: BorderRadius::all(px(0.5 * size)),
        max_width: percent(60),
        ..at(settings.corner)
    };
    let background = BackgroundColor(Color::srgba(0.10, 0.11, 0.12, 0.92));
    commands.spawn((Panel, panel, background, GlobalZIndex(Z))).with_children(|panel| {
        panel.spawn((Figures::default(), text("", 1.15 * size, TEXT)));
        panel.spawn(Node { column_gap: px(size), flex_wrap: FlexWrap::Wrap, ..default() }).with_children(|legend| {
            for level in 0..=LEVELS {
                legend.spawn(legend_entry(level, size));
            }
        });
        panel.spawn((Mode, text("", 0.9 * size, DIM)));
        panel.spawn((MemoryLines, text("", 0.9 * size, DIM)));
        #[cfg(feature = "bake")]
        panel.spawn((
            BakeList::default(),
            Node {
                flex_direction: FlexDirection::Column,
                row_gap: px(0.25 * size),
                display: Display::None,
                ..default()
            },
        ));
    });
}

/// A node in a corner of the window.
fn at(corner: OverlayCorner) -> Node {
    let margin = px(MARGIN);
    let (left, right) = match corner {
        OverlayCorner::TopLeft | OverlayCorner::BottomLeft => (margin, auto()),
        OverlayCorner::TopRight | OverlayCorner::BottomRight => (auto(), margin),
    };
    let (top, bottom) = match corner {
        OverlayCorner::TopLeft | OverlayCorner::TopRight => (margin, auto()),
        OverlayCorner::BottomLeft | OverlayCorner::BottomRight => (auto(), margin),
    };
    Node { position_type: PositionType::Absolute, left, right, top, bottom, ..default() }
}

fn legend_entry(level: u32, size: f32) -> impl Bundle {
    let side = px(0.85 * size);
    (
        LegendEntry(level),
        Node { column_gap: px(0.4 * size), align_items: AlignItems::Center, display: Display::None, ..default() },
        children![
            (
                Node { width: side, height: side, border_radius: BorderRadius::all(px(0.2 * size)), ..default() },
                BackgroundColor(level_color(level)),
            ),
            text("", size, TEXT),
        ],
    )
}
