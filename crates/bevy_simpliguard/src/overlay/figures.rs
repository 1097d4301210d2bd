//! The figures in the panel: triangles, draw calls, frame time and levels.

use std::time::Duration;

use bevy::prelude::*;

use crate::lod::{LodGroup, LodSettings, LodStats};

/// Time over which frame times are averaged. Numbers that change faster cannot be read.
const WINDOW: Duration = Duration::from_millis(250);

/// The line with triangles and frame time. It shows the mean of the frames in the last window.
#[derive(Component, Default)]
pub(super) struct Figures {
    frames: u32,
    elapsed: Duration,
    shown: Option<Duration>,
}

/// The line that tells how levels are selected.
#[derive(Component)]
pub(super) struct Mode;

/// The entry of the legend for the level with this number.
#[derive(Component)]
pub(super) struct LegendEntry(pub(super) u32);

impl Figures {
    /// Adds a frame. Frames that are longer than the window are shown one by one.
    fn add(&mut self, frame: Duration) {
        self.frames += 1;
        self.elapsed += frame;
        if self.elapsed >= WINDOW {
            self.shown = Some(self.elapsed / self.frames);
            (self.frames, self.elapsed) = (0, Duration::ZERO);
        }
    }
}

/// Updates the line with triangles and frame time.
pub(super) fn figures(
    line: Single<'_, '_, (&mut Figures, &mut Text)>,
    stats: Res<'_, LodStats>,
    time: Res<'_, Time<Real>>,
) {
    let (mut figures, mut text) = line.into_inner();
    figures.add(time.delta());
    let frame = figures.shown.map(|time| format!("{:.1} ms", 1e3 * time.as_secs_f64())).unwrap_or_default();
    text.set_if_neq(Text(format!("{}   {frame}", triangles(&stats))));
}

/// The text about triangles and draw calls. Models without levels are not counted.
fn triangles(stats: &LodStats) -> String {
    let (drawn, source) = (stats.triangles, stats.source_triangles);
    if source == 0 {
        return "no model with levels in view".into();
    }
    let percent = 100.0 * drawn as f64 / source as f64;
    let [calls, all] = [stats.draw_calls, stats.source_draw_calls].map(thousands);
    format!("{} of {} triangles ({percent:.1} %)   {calls} of {all} draw calls", thousands(drawn), thousands(source))
}

/// Shows the levels that the instances have, and the number of instances in view that show each level.
pub(super) fn legend(
    mut entries: Query<'_, '_, (&LegendEntry, &mut Node, &Children)>,
    mut texts: Query<'_, '_, &mut Text>,
    stats: Res<'_, LodStats>,
    groups: Query<'_, '_, &LodGroup>,
) {
    let highest = groups.iter().flat_map(|group| &group.levels).map(|level| level.level).max().unwrap_or(0);
    for (entry, mut node, children) in &mut entries {
        let display = if highest > 0 && entry.0 <= highest { Display::Flex } else { Display::None };
        if node.display != display {
            node.display = display;
        }
        let name = if entry.0 == 0 { "source".into() } else { format!("LOD{}", entry.0) };
        let shown = stats.levels.get(entry.0 as usize).map_or(0, |level| level.groups);
        for child in children {
            if let Ok(mut text) = texts.get_mut(*child) {
                text.set_if_neq(Text(format!("{name} {}", thousands(shown.into()))));
            }
        }
    }
}

/// Updates the line that tells how levels are selected.
pub(super) fn mode(mut text: Single<'_, '_, &mut Text, With<Mode>>, settings: Res<'_, LodSettings>) {
    let line = match settings.force {
        _ if !settings.enabled => "levels off: the source everywhere".into(),
        Some(0) => "the source everywhere".into(),
        Some(level) => format!("LOD{level} everywhere"),
        None => format!("levels by distance: {} px, bias {}", settings.pixel_error, settings.bias),
    };
    text.set_if_neq(Text(line));
}

/// Formats a number with a comma between groups of three digits.
pub fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_come_in_groups_of_three() {
        assert_eq!(thousands(0), "0");
        assert_eq!(thousands(999), "999");
        assert_eq!(thousands(1_000), "1,000");
        assert_eq!(thousands(12_345_678), "12,345,678");
    }

    #[test]
    fn short_frames_are_averaged_and_long_ones_shown() {
        let mut figures = Figures::default();
        (0..4).for_each(|_| figures.add(Duration::from_millis(60)));
        assert_eq!(figures.shown, None);
        figures.add(Duration::from_millis(20));
        assert_eq!(figures.shown, Some(Duration::from_millis(52)));
        figures.add(Duration::from_millis(900));
        assert_eq!(figures.shown, Some(Duration::from_millis(900)));
    }
}
