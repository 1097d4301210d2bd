//! The choice of the sources that are to be there: pure arithmetic, without Bevy's world.
//!
//! Distances are in units of the distance at which an instance shows its first level alone for the first time. So they count
//! zoom, scale and settings in, and a source is to be seen below 1.

/// The distance below which a source is wanted. Above it there is time to load.
pub(super) const NEAR: f32 = 1.1;
/// Factor on the distances of sources that are there, so that two at equal distances do not take turns.
const HELD: f32 = 0.8;

/// The least distance that an instance has within `ahead` seconds, if it goes on coming nearer as it did from `before` to
/// `now` in `seconds`.
pub(super) fn distance_ahead(before: f32, now: f32, seconds: f32, ahead: f32) -> f32 {
    let speed = (before - now) / seconds;
    if speed.is_finite() && speed > 0.0 { (now - speed * ahead.max(0.0)).max(0.0) } else { now }
}

/// A source that may be there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// Distance of the nearest instance.
    pub(super) distance: f32,
    /// True if it was wanted a short while ago, or is.
    pub(super) is_recent: bool,
    /// True if it is there, or on its way.
    pub(super) is_held: bool,
    pub(super) bytes: u64,
}

/// Tells for each candidate if it is to be there: the nearest that have room in the budget, then those that were wanted not
/// long ago.
pub(super) fn choose(candidates: &[Candidate], budget: u64) -> Vec<bool> {
    let mut order: Vec<usize> = (0..candidates.len()).filter(|&i| candidates[i].is_recent).collect();
    let rank = |i: usize| {
        let Candidate { distance, is_held, .. } = candidates[i];
        (distance >= NEAR, if is_held { HELD * distance } else { distance })
    };
    order.sort_by(|&a, &b| {
        let ((is_far, a_distance), (is_farther, b_distance)) = (rank(a), rank(b));
        is_far.cmp(&is_farther).then(a_distance.total_cmp(&b_distance)).then(a.cmp(&b))
    });
    let (mut chosen, mut left) = (vec![false; candidates.len()], budget);
    for i in order {
        // One that is too large leaves room for others.
        if let Some(rest) = left.checked_sub(candidates[i].bytes) {
            (chosen[i], left) = (true, rest);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(distance: f32, bytes: u64) -> Candidate {
        Candidate { distance, is_recent: true, is_held: false, bytes }
    }

    #[test]
    fn what_comes_nearer_is_seen_ahead() {
        assert_eq!(distance_ahead(10.0, 9.0, 0.5, 2.0), 5.0);
        assert_eq!(distance_ahead(10.0, 9.0, 0.5, 60.0), 0.0);
        assert_eq!(distance_ahead(9.0, 10.0, 0.5, 2.0), 10.0);
        for before in [f32::INFINITY, f32::NAN] {
            assert_eq!(distance_ahead(before, 3.0, 0.5, 2.0), 3.0);
        }
        assert_eq!(distance_ahead(1.0, f32::INFINITY, 0.5, 2.0), f32::INFINITY);
        assert_eq!(distance_ahead(3.0, 3.0, 0.0, 2.0), 3.0);
    }

    #[test]
    fn the_nearest_have_the_budget() {
        let all = [candidate(0.5, 4), candidate(0.1, 4), candidate(0.9, 4), candidate(0.2, 9)];
        assert_eq!(choose(&all, 8), [true, true, false, false]);
        assert_eq!(choose(&all, 13), [false, true, false, true]);
        assert_eq!(choose(&all, 3), [false; 4]);
        assert_eq!(choose(&all, 21), [true; 4]);
    }

    #[test]
    fn what_is_there_stays_unless_another_is_much_nearer() {
        let held = Candidate { is_held: true, ..candidate(0.5, 4) };
        assert_eq!(choose(&[candidate(0.45, 4), held], 4), [false, true]);
        assert_eq!(choose(&[candidate(0.3, 4), held], 4), [true, false]);
    }

    #[test]
    fn what_is_no_longer_wanted_stays_where_there_is_room() {
        let (gone, left) = (Candidate { is_held: true, ..candidate(2.0, 4) }, candidate(0.9, 4));
        assert_eq!(choose(&[gone, left], 8), [true, true]);
        assert_eq!(choose(&[gone, left], 4), [false, true]);
        assert_eq!(choose(&[Candidate { is_recent: false, ..gone }], 8), [false]);
    }
}
