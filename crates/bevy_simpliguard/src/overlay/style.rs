//! Texts of the panel.

use bevy::prelude::*;

pub(super) const TEXT: Color = Color::srgb(0.94, 0.94, 0.92);
pub(super) const DIM: Color = Color::srgb(0.70, 0.71, 0.72);

/// A text of `size` logical pixels.
pub(super) fn text(text: &str, size: f32, color: Color) -> impl Bundle + use<> {
    (Text::new(text), TextFont::from_font_size(size), TextColor(color))
}
