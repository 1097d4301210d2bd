//! The selection of a level by distance: pure arithmetic, without Bevy's world.
//!
//! A camera at a distance `d` draws one unit as `p = h / (2 d tan(fov / 2))` pixels, where `h` is the height of the
//! viewport. A level with an error of `e` units is used from the distance where `e p` falls to the allowed error in
//! pixels. Distances are measured to the nearest point of the object's bounding sphere, so the bound holds for the
//! whole object. They are not measured to the view plane, so that turning the camera switches no level. An orthographic
//! camera has one `p` for all distances.

use bevy::math::{Mat4, Vec3};

/// Hysteresis of levels that switch without a fade, as a fraction of the level's distance: a camera must come closer by
/// this much before the level is left again. Without it, levels would flicker at the distance itself.
const HYSTERESIS: f32 = 0.05;

/// Number of steps of a cross-fade: the renderer dithers in a pattern of 4 x 4 pixels.
pub(super) const FADE_STEPS: u8 = 16;

/// Distance in world units at which an error of `error` world units is `pixel_error` pixels long, with a viewport of
/// `height` pixels and a vertical field of view of `fov` radians.
pub(super) fn switch_distance(error: f32, height: f32, fov: f32, pixel_error: f32) -> f32 {
    error * height / (2.0 * (0.5 * fov).tan() * pixel_error)
}

/// The properties of a camera that decide sizes on the screen.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    position: Vec3,
    /// Pixels per world unit. For a perspective camera, at a distance of one unit.
    scale: f32,
    is_perspective: bool,
}

impl View {
    /// A camera at `position` with a viewport of `height` physical pixels.
    pub(super) fn new(position: Vec3, clip_from_view: Mat4, height: f32) -> Self {
        Self {
            position,
            scale: 0.5 * height * clip_from_view.y_axis.y.abs(),
            is_perspective: clip_from_view.w_axis.w == 0.0,
        }
    }

    /// Pixels per world unit at the nearest point of a sphere. The largest number if the camera is inside.
    pub(super) fn pixels_per_unit(&self, center: Vec3, radius: f32) -> f32 {
        if !self.is_perspective {
            return self.scale;
        }
        let distance = self.position.distance(center) - radius;
        if distance > 0.0 { (self.scale / distance).min(f32::MAX) } else { f32::MAX }
    }
}

/// A level that is used at some distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rung {
    /// Index of the level in its group.
    pub(super) slot: usize,
    /// Error that decides its distance, as a fraction of the object's diagonal. 0 for the first.
    error: f32,
}

/// The levels that are used, in falling detail. `errors` are those of the group's levels in the same order. The first
/// level stands for the object up close, whatever its error is.
///
/// Errors never fall along the result. A level is left out if the next one would begin before its own cross-fade has
/// ended.
pub(super) fn rungs(errors: impl IntoIterator<Item = f32>, fade: f32) -> Vec<Rung> {
    let mut reached = 0.0_f32;
    let mut all = Vec::new();
    for (slot, error) in errors.into_iter().enumerate() {
        reached = if slot == 0 { 0.0 } else { reached.max(error) };
        all.push(Rung { slot, error: reached });
    }
    let mut next = f32::INFINITY;
    let mut used: Vec<Rung> = Vec::with_capacity(all.len());
    for rung in all.into_iter().rev() {
        let is_alone = next > rung.error && next >= rung.error * (1.0 + fade);
        if rung.slot == 0 || is_alone {
            next = rung.error;
            used.push(rung);
        }
    }
    used.reverse();
    used
}

/// The level, or the two levels, of a group that are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Choice {
    /// Index of the level in view, or of the one that is fading out.
    pub(super) slot: usize,
    /// Index of the level that is fading in, and the fraction of its pixels in sixteenths, from 1 to 15.
    pub(super) next: Option<(usize, u8)>,
}

impl Choice {
    pub(super) fn only(slot: usize) -> Self {
        Self { slot, next: None }
    }

    /// Index of the level with the most pixels.
    pub(super) fn main(&self) -> usize {
        match self.next {
            Some((next, step)) if 2 * step >= FADE_STEPS => next,
            _ => self.slot,
        }
    }
}

/// The distance of an object whose diagonal is `size` pixels long, in units of the distance from which the next coarser level is
/// shown alone. The level with the index `slot`, or a more detailed one, is seen below 1. Infinite for a level that is not used.
pub(super) fn level_distance(rungs: &[Rung], slot: usize, size: f32, pixel_error: f32, fade: f32) -> f32 {
    let Some(place) = rungs.iter().position(|rung| rung.slot == slot) else { return f32::INFINITY };
    let Some(coarser) = rungs.get(place + 1).filter(|_| pixel_error > 0.0) else { return 0.0 };
    let distance = pixel_error / (coarser.error * size * (1.0 + fade));
    if distance.is_nan() { f32::INFINITY } else { distance }
}

/// Selects the level of an object whose diagonal is `size` pixels long. `current` is the level in view so far.
pub(super) fn choose(rungs: &[Rung], size: f32, pixel_error: f32, fade: f32, current: usize) -> Choice {
    for pair in rungs.windows(2).rev() {
        let (finer, rung) = (pair[0], pair[1]);
        // Distance of the object, in units of the distance at which this level starts.
        let ratio = pixel_error / (rung.error * size);
        let start = if fade == 0.0 && rung.slot <= current { 1.0 - HYSTERESIS } else { 1.0 };
        if ratio.is_nan() || ratio < start {
            continue;
        }
        if fade == 0.0 {
            return Choice::only(rung.slot);
        }
        let steps = f32::from(FADE_STEPS);
        return match (steps * (ratio - 1.0) / fade).round().min(steps) as u8 {
            0 => Choice::only(finer.slot),
            FADE_STEPS => Choice::only(rung.slot),
            step => Choice { slot: finer.slot, next: Some((rung.slot, step)) },
        };
    }
    Choice::only(0)
}

#[cfg(test)]
mod tests {
    use bevy::math::vec3;

    use super::*;

    /// With this field of view half the viewport's height is one unit long at a distance of one.
    const RIGHT_ANGLE: f32 = std::f32::consts::FRAC_PI_2;

    fn perspective(height: f32) -> View {
        View::new(Vec3::ZERO, Mat4::perspective_infinite_reverse_rh(RIGHT_ANGLE, 1.5, 0.1), height)
    }

    fn fading(slot: usize, next: usize, step: u8) -> Choice {
        Choice { slot, next: Some((next, step)) }
    }

    #[test]
    fn distance_grows_with_error_and_height_and_falls_with_the_pixel_error() {
        let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-3 * b, "{a} {b}");
        close(switch_distance(0.01, 1000.0, RIGHT_ANGLE, 1.0), 5.0);
        close(switch_distance(0.02, 1000.0, RIGHT_ANGLE, 1.0), 10.0);
        close(switch_distance(0.01, 2000.0, RIGHT_ANGLE, 4.0), 2.5);
        close(switch_distance(0.01, 1000.0, 2.0 * 0.5_f32.atan(), 1.0), 10.0);
    }

    #[test]
    fn perspective_counts_from_the_nearest_point_of_the_sphere() {
        let view = perspective(1000.0);
        assert!((view.pixels_per_unit(vec3(0.0, 0.0, -6.0), 1.0) - 100.0).abs() < 1e-3);
        assert!((view.pixels_per_unit(vec3(6.0, 0.0, 0.0), 1.0) - 100.0).abs() < 1e-3);
        assert_eq!(view.pixels_per_unit(vec3(0.0, 0.0, -1.0), 2.0), f32::MAX);
    }

    #[test]
    fn a_part_of_the_full_view_has_the_scale_of_its_own_pixels() {
        // The middle half of a view on the whole viewport: everything is drawn twice as large.
        let whole = Mat4::perspective_infinite_reverse_rh(RIGHT_ANGLE, 1.0, 0.1);
        let part = Mat4::from_scale(vec3(2.0, 2.0, 1.0)) * whole;
        let size = |clip| View::new(Vec3::ZERO, clip, 800.0).pixels_per_unit(vec3(0.0, 0.0, -4.0), 0.0);
        assert!((size(part) - 2.0 * size(whole)).abs() < 1e-3);
    }

    #[test]
    fn orthographic_sizes_do_not_depend_on_the_distance() {
        let clip = Mat4::orthographic_rh(-8.0, 8.0, -5.0, 5.0, 0.0, 100.0);
        let view = View::new(Vec3::ZERO, clip, 1000.0);
        for z in [0.0, -1.0, -90.0] {
            assert!((view.pixels_per_unit(vec3(0.0, 0.0, z), 3.0) - 100.0).abs() < 1e-3);
        }
    }

    #[test]
    fn each_level_is_used_from_where_its_own_error_is_small_enough() {
        let rungs = rungs([0.0, 0.01, 0.02, 0.04], 0.1);
        // Sizes at which the three errors are one pixel long: 100, 50 and 25 pixels.
        let slot = |size: f32| choose(&rungs, size, 1.0, 0.1, 0);
        assert_eq!(slot(f32::MAX), Choice::only(0));
        assert_eq!(slot(101.0), Choice::only(0));
        assert_eq!(slot(90.0), Choice::only(1));
        assert_eq!(slot(51.0), Choice::only(1));
        assert_eq!(slot(45.0), Choice::only(2));
        assert_eq!(slot(20.0), Choice::only(3));
        assert_eq!(slot(0.0), Choice::only(3));
    }

    #[test]
    fn a_fade_runs_over_its_fraction_of_the_distance() {
        let rungs = rungs([0.0, 0.01], 0.5);
        // The level starts at a size of 100 pixels; a fade of 0.5 ends at 1.5 times that distance.
        let at = |distance: f32| choose(&rungs, 100.0 / distance, 1.0, 0.5, 0);
        assert_eq!(at(1.0), Choice::only(0));
        assert_eq!(at(1.125), fading(0, 1, 4));
        assert_eq!(at(1.25), fading(0, 1, 8));
        assert_eq!(at(1.375), fading(0, 1, 12));
        assert_eq!(at(1.5), Choice::only(1));
        assert_eq!((at(1.125).main(), at(1.25).main()), (0, 1));
    }

    #[test]
    fn levels_change_in_steps_of_one_fade_at_every_distance() {
        let rungs = rungs([0.0, 0.010, 0.0112, 0.03, 0.02], 0.1);
        let mut last = Choice::only(0);
        for i in 0..4000 {
            let now = choose(&rungs, 200.0 * (-0.002 * i as f32).exp(), 1.0, 0.1, 0);
            let is_near = |a: Choice, b: Choice| match (a.next, b.next) {
                (None, None) => a.slot == b.slot,
                (None, Some((_, step))) => a.slot == b.slot && step <= 2,
                (Some((next, step)), None) => b.slot == next && step >= 14 || b.slot == a.slot && step <= 2,
                (Some((n, s)), Some((m, t))) => a.slot == b.slot && n == m && s.abs_diff(t) <= 2,
            };
            assert!(is_near(last, now), "{last:?} then {now:?}");
            last = now;
        }
        assert_eq!(last, Choice::only(4));
    }

    #[test]
    fn a_level_no_better_than_a_coarser_one_is_never_used() {
        let slots =
            |errors: &[f32], fade| rungs(errors.iter().copied(), fade).iter().map(|r| r.slot).collect::<Vec<_>>();
        assert_eq!(slots(&[0.0, 0.02, 0.01], 0.1), [0, 2]);
        assert_eq!(slots(&[0.0, 0.01, 0.01], 0.0), [0, 2]);
        assert_eq!(slots(&[0.0, 0.01, 0.0105], 0.1), [0, 2]);
        assert_eq!(slots(&[0.0, 0.01, 0.0105], 0.0), [0, 1, 2]);
        assert_eq!(slots(&[0.03, 0.01], 0.1), [0, 1]);
        assert_eq!(slots(&[0.0], 0.1), [0]);
    }

    #[test]
    fn a_level_without_error_is_used_at_any_distance() {
        let rungs = rungs([0.0, 0.0, 0.01], 0.1);
        assert_eq!(choose(&rungs, f32::MAX, 1.0, 0.1, 0), Choice::only(1));
    }

    #[test]
    fn without_a_fade_a_level_is_left_later_than_it_is_entered() {
        let rungs = rungs([0.0, 0.01, 0.02], 0.0);
        let slot = |size: f32, current| choose(&rungs, size, 1.0, 0.0, current).slot;
        assert_eq!((slot(102.0, 0), slot(99.0, 0)), (0, 1));
        assert_eq!((slot(102.0, 1), slot(106.0, 1)), (1, 0));
        assert_eq!((slot(52.0, 1), slot(52.0, 2), slot(53.0, 2)), (1, 2, 1));
    }

    #[test]
    fn a_level_or_a_more_detailed_one_is_seen_below_a_distance_of_one() {
        let rungs = rungs([0.0, 1.0 / 128.0, 1.0 / 130.0, 1.0 / 32.0], 1.0);
        let distance = |slot, size| level_distance(&rungs, slot, size, 1.0, 1.0);
        // The second level begins at a size of 128 pixels, and is alone at half of it. The next is alone at 16 pixels.
        assert_eq!([64.0, 256.0].map(|size| distance(0, size)), [1.0, 0.25]);
        assert_eq!([16.0, 64.0].map(|size| distance(2, size)), [1.0, 0.25]);
        assert_eq!(choose(&rungs, 66.0, 1.0, 1.0, 0).slot, 0);
        assert_eq!(choose(&rungs, 64.0, 1.0, 1.0, 0), Choice::only(2));
        assert_eq!(distance(1, 64.0), f32::INFINITY, "it is not used");
        assert_eq!(distance(3, 64.0), 0.0, "nothing is coarser");
        assert_eq!(level_distance(&rungs, 0, 200.0, 0.0, 1.0), 0.0);
        assert_eq!(level_distance(&super::rungs([0.0, 0.0], 0.5), 0, 200.0, 1.0, 0.5), f32::INFINITY);
    }

    #[test]
    fn no_allowed_error_means_the_first_level() {
        let rungs = rungs([0.0, 0.0, 0.01], 0.1);
        for pixel_error in [0.0, -1.0, f32::NAN] {
            assert_eq!(choose(&rungs, 10.0, pixel_error, 0.1, 0), Choice::only(0));
        }
    }
}
