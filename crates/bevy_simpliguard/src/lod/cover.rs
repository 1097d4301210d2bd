//! Stand-ins for a source or a level that is loaded on demand and not there yet.

use super::distance::{Choice, FADE_STEPS, Rung};
use super::fade::Show;

/// A level that stands before a more detailed one until that is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cover {
    pub(super) slot: usize,
    /// Sixteenths of its pixels that have given way to the other. That is drawn whole behind it, so that no pixel is without
    /// either while a renderer gets ready for it.
    pub(super) step: u8,
}

impl Cover {
    /// The visible pixels of the cover, if its group is not veiled.
    pub(super) fn show(self, choice: Choice, whole: Show) -> Show {
        let can_fade = choice.next.is_none() && whole == Show::Whole;
        if self.step > 0 && can_fade { Show::FadeOut(self.step) } else { whole }
    }
}

/// The levels that are drawn for a choice while some are away or on their way. `steps` is a function of a level's index: it
/// returns the sixteenths of the level's pixels that may be seen, and `None` while the level is away.
///
/// The next coarser level replaces one that is away. One that is on its way gets the next coarser level that is there as its
/// cover.
pub(super) fn stand_in(choice: Choice, rungs: &[Rung], steps: impl Fn(usize) -> Option<u8>) -> (Choice, Option<Cover>) {
    let coarser = |slot: usize| rungs.iter().map(|rung| rung.slot).filter(move |other| *other > slot);
    let or_coarser = |slot: usize| std::iter::once(slot).chain(coarser(slot));
    let whole = |slot: usize| or_coarser(slot).find(|slot| steps(*slot) == Some(FADE_STEPS)).unwrap_or(slot);
    let slot = or_coarser(choice.slot).find(|slot| steps(*slot).is_some()).unwrap_or(choice.slot);
    let next = choice.next.filter(|(next, _)| *next > slot).map(|(next, step)| (whole(next), step));
    let cover = steps(slot).filter(|step| *step < FADE_STEPS).map(|step| Cover { slot: whole(slot), step });
    (Choice { slot, next }, cover.filter(|cover| cover.slot != slot))
}

#[cfg(test)]
mod tests {
    use super::super::distance::rungs;
    use super::*;

    /// The drawn levels of a source and three levels, the last of which is always there.
    fn drawn(choice: Choice, [source, first, second]: [Option<u8>; 3]) -> (Choice, Option<Cover>) {
        let rungs = rungs([0.0, 0.01, 0.02, 0.04], 0.1);
        stand_in(choice, &rungs, |slot| [source, first, second, Some(FADE_STEPS)][slot])
    }

    const THERE: Option<u8> = Some(FADE_STEPS);

    fn fading(slot: usize, next: usize) -> Choice {
        Choice { slot, next: Some((next, 4)) }
    }

    #[test]
    fn what_is_there_is_drawn() {
        for choice in [Choice::only(0), fading(0, 1), fading(2, 3), Choice::only(3)] {
            assert_eq!(drawn(choice, [THERE; 3]), (choice, None));
        }
    }

    #[test]
    fn the_next_coarser_one_stands_in() {
        assert_eq!(drawn(Choice::only(0), [None; 3]), (Choice::only(3), None));
        assert_eq!(drawn(Choice::only(0), [None, None, THERE]), (Choice::only(2), None));
        assert_eq!(drawn(Choice::only(0), [None, THERE, None]), (Choice::only(1), None));
        assert_eq!(drawn(Choice::only(1), [THERE, None, None]), (Choice::only(3), None), "never a more detailed one");
    }

    #[test]
    fn one_that_arrives_has_a_cover() {
        let cover = |slot, step| Some(Cover { slot, step });
        assert_eq!(drawn(Choice::only(0), [Some(0), THERE, THERE]), (Choice::only(0), cover(1, 0)));
        assert_eq!(drawn(Choice::only(0), [Some(7), None, Some(3)]), (Choice::only(0), cover(3, 7)));
        assert_eq!(drawn(Choice::only(0), [None, Some(3), THERE]), (Choice::only(1), cover(2, 3)));
    }

    #[test]
    fn fades_lead_to_what_is_there() {
        assert_eq!(drawn(fading(0, 1), [THERE, None, THERE]), (fading(0, 2), None));
        assert_eq!(drawn(fading(0, 1), [None, THERE, THERE]), (Choice::only(1), None));
        assert_eq!(drawn(fading(0, 1), [None, None, THERE]), (Choice::only(2), None));
        let arriving = Some(Cover { slot: 1, step: 5 });
        assert_eq!(drawn(fading(0, 1), [Some(5), THERE, THERE]), (fading(0, 1), arriving));
    }

    #[test]
    fn a_level_that_no_distance_asks_for_stands_in_for_nothing() {
        let rungs = rungs([0.0, 0.02, 0.01], 0.1);
        let drawn = |choice, away: usize| stand_in(choice, &rungs, |slot| (slot != away).then_some(FADE_STEPS));
        assert_eq!(drawn(Choice::only(0), 0), (Choice::only(2), None));
        assert_eq!(drawn(Choice::only(1), 1), (Choice::only(2), None), "one that is forced");
    }
}
