//! Numbers and colours of levels.

use bevy::color::Color;

/// Highest number that a level may have.
pub const LEVELS: u32 = 8;

/// The colour of a level in legends. The source, number 0, is light grey.
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
