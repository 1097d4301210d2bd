//! Fades: the members of a group are shown, hidden or dithered with `VisibilityRange`s that act alike at any distance.
//!
//! Bevy measures a [`VisibilityRange`] from the camera to the origin of each entity, on the CPU for culling and in the
//! vertex shader for dithering. The parts of a model and its levels have different origins, so with real distances they
//! would switch one by one. Here the ranges encode the group's one selection instead: their margins are so long that no
//! distance in a game changes the result. Culling, shadow maps and the render world use them like any other range.
//! `Visibility` is left to the game.
//!
//! There are 33 such ranges. They fit into the smallest table of ranges that Bevy has (64 entries on WebGL 2).

use bevy::camera::visibility::VisibilityRange;

use super::distance::FADE_STEPS;

/// Length of a margin. It is longer than any distance, and far below the largest `f32`.
const FAR: f32 = 1e30;

/// The visible part of a member.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Show {
    /// No pixels.
    Nothing,
    /// All pixels, without dithering in the material.
    Solid,
    /// All pixels, with dithering in the material, so that no other material has to be compiled when a fade starts.
    Whole,
    /// So many sixteenths of the pixels, from 1 to 15.
    FadeIn(u8),
    /// All but so many sixteenths of the pixels: exactly those that `FadeIn` leaves out.
    FadeOut(u8),
}

impl Show {
    /// The range that shows this at any distance.
    pub(super) fn range(self) -> VisibilityRange {
        let offset = |step: u8| FAR * f32::from(step) / f32::from(FADE_STEPS);
        let (start_margin, end_margin) = match self {
            Self::Nothing => (FAR..FAR, FAR..FAR),
            Self::Solid => (-FAR..-FAR, FAR..FAR),
            Self::Whole => (-2.0 * FAR..-FAR, FAR..2.0 * FAR),
            Self::FadeIn(step) => (-offset(step)..FAR - offset(step), 2.0 * FAR..3.0 * FAR),
            Self::FadeOut(step) => (-3.0 * FAR..-2.0 * FAR, -offset(step)..FAR - offset(step)),
        };
        VisibilityRange { start_margin, end_margin, use_aabb: false }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DISTANCES: [f32; 5] = [0.0, 1e-3, 1.0, 5e3, 1e9];

    /// `get_visibility_range_dither_level` of bevy_pbr's `mesh_functions.wgsl`.
    fn dither(range: &VisibilityRange, distance: f32) -> i32 {
        let (offset, margin) =
            if distance >= range.end_margin.start { (0, &range.end_margin) } else { (-16, &range.start_margin) };
        let level = ((distance - margin.start) / (margin.end - margin.start) * 16.0).round() as i32;
        offset + level.clamp(0, 16)
    }

    /// Tells whether `visibility_range_dither` of bevy_pbr's `pbr_functions.wgsl` keeps a pixel with this threshold (0
    /// to 15).
    fn keeps(dither: i32, threshold: i32) -> bool {
        match dither {
            0 => true,
            ..=-16 | 16.. => false,
            1.. => dither + threshold < 16,
            _ => 1 + dither + threshold > 0,
        }
    }

    #[test]
    fn what_is_shown_whole_or_not_at_all_is_so_at_any_distance() {
        for distance in DISTANCES {
            assert!(Show::Nothing.range().is_culled(distance));
            assert!(Show::Solid.range().is_visible_at_all(distance));
            let whole = Show::Whole.range();
            assert!(whole.is_visible_at_all(distance));
            assert_eq!(dither(&whole, distance), 0);
        }
        assert!(Show::Solid.range().is_abrupt() && !Show::Whole.range().is_abrupt());
    }

    #[test]
    fn both_sides_of_a_fade_share_the_pixels_without_gap_or_overlap() {
        for (step, distance) in (1..FADE_STEPS).flat_map(|s| DISTANCES.map(|d| (s, d))) {
            let (fade_in, fade_out) = (Show::FadeIn(step).range(), Show::FadeOut(step).range());
            assert!(fade_in.is_visible_at_all(distance) && fade_out.is_visible_at_all(distance));
            assert!(!fade_in.is_abrupt() && !fade_out.is_abrupt());
            let (appearing, leaving) = (dither(&fade_in, distance), dither(&fade_out, distance));
            assert_eq!((appearing, leaving), (i32::from(step) - 16, i32::from(step)));
            let kept = (0..16).filter(|&t| keeps(appearing, t)).count();
            assert_eq!(kept, usize::from(step));
            assert!((0..16).all(|t| keeps(appearing, t) != keeps(leaving, t)));
        }
    }

    #[test]
    fn margins_are_in_order_as_bevy_asks() {
        let fades = (1..FADE_STEPS).flat_map(|s| [Show::FadeIn(s), Show::FadeOut(s)]);
        for show in fades.chain([Show::Nothing, Show::Solid, Show::Whole]) {
            let VisibilityRange { start_margin: a, end_margin: b, .. } = show.range();
            assert!(a.start <= a.end && a.end <= b.start && b.start <= b.end, "{show:?}");
        }
    }
}
