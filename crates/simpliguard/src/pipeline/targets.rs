//! From targets to face budgets.
//!
//! The distance of a surface to the source is only known once the surface is made. Where a target asks for a distance,
//! surfaces are made for a ladder of budgets in one collapse, which costs little more than making the last. The lowest
//! rung within the tolerance becomes the level.

use crate::data::Deviation;
use crate::settings::Target;

/// Lowest and highest rung of the ladder, in faces; a rung has about 1.4 times the faces of the one below.
const LADDER: (f64, f64) = (125.0, 16_000.0);
/// Fewest faces of a level.
const FEWEST: u32 = 4;

/// The targets of a bake.
pub(crate) struct Targets {
    targets: Vec<Target>,
    source_faces: usize,
}

impl Targets {
    /// Targets for a source with so many faces.
    pub(crate) fn new(targets: &[Target], source_faces: usize) -> Self {
        Self { targets: targets.to_vec(), source_faces }
    }

    /// The budgets to make shapes for, ascending; those of at least the source's faces are left out.
    pub(crate) fn budgets(&self) -> Vec<u32> {
        let mut budgets: Vec<u32> = self.targets.iter().filter_map(|t| self.budget(*t)).collect();
        if self.targets.iter().any(|t| t.tolerance().is_some()) {
            let rungs = std::iter::successors(Some(LADDER.0), |n| Some(n * std::f64::consts::SQRT_2));
            budgets.extend(rungs.take_while(|n| *n < 1.01 * LADDER.1).map(|n| n.round() as u32));
        }
        budgets.retain(|&n| (n as usize) < self.source_faces);
        budgets.sort_unstable();
        budgets.dedup();
        budgets
    }

    /// Which of the budgets become levels, ascending, given the deviations of their shapes; and a note for each target
    /// that no shape meets.
    pub(crate) fn choose(&self, budgets: &[u32], deviations: &[Deviation]) -> (Vec<usize>, Vec<String>) {
        let (mut chosen, mut notes) = (Vec::new(), Vec::new());
        for target in &self.targets {
            let within = |tolerance: f32| deviations.iter().position(|d| d.percentile_95 <= tolerance);
            let found = match target.tolerance() {
                None => budgets.iter().position(|&n| Some(n) == self.budget(*target)),
                Some(tolerance) => within(tolerance).or_else(|| {
                    let (faces, reached) = (budgets.last()?, deviations.last()?.percentile_95);
                    notes.push(format!("{target:?} is not met: a level of {faces} faces has a deviation of {reached}"));
                    Some(budgets.len() - 1)
                }),
            };
            chosen.extend(found);
        }
        chosen.sort_unstable();
        chosen.dedup();
        (chosen, notes)
    }

    fn budget(&self, target: Target) -> Option<u32> {
        match target {
            Target::Faces(n) => Some(n),
            Target::Ratio(part) => Some(((f64::from(part) * self.source_faces as f64) as u32).max(FEWEST)),
            Target::MaxDeviation(_) | Target::ScreenSize(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn targets(targets: &[Target], source_faces: usize) -> Targets {
        Targets::new(targets, source_faces)
    }

    fn deviations(values: &[f32]) -> Vec<Deviation> {
        values.iter().map(|&percentile_95| Deviation { percentile_95, ..Deviation::default() }).collect()
    }

    #[test]
    fn budgets_of_the_source_or_more_are_left_out() {
        let budgets = [1000, 2000, 4000].map(Target::Faces);
        assert_eq!(targets(&budgets, 3000).budgets(), [1000, 2000]);
    }

    #[test]
    fn a_ratio_counts_from_the_source() {
        let targets = targets(&[Target::Ratio(0.5), Target::Ratio(0.1), Target::Faces(90)], 1000);
        assert_eq!(targets.budgets(), [90, 100, 500]);
        assert_eq!(targets.choose(&[90, 100, 500], &deviations(&[0.3, 0.2, 0.1])).0, [0, 1, 2]);
    }

    #[test]
    fn a_distance_gets_the_lowest_rung_within_it() {
        let targets = targets(&[Target::ScreenSize(100), Target::Faces(300)], 700);
        let budgets = targets.budgets();
        assert_eq!(budgets, [125, 177, 250, 300, 354, 500]);
        let deviations = deviations(&[0.05, 0.02, 0.01, 0.009, 0.004, 0.001]);
        let (chosen, notes) = targets.choose(&budgets, &deviations);
        assert!(chosen == [2, 3] && notes.is_empty(), "{chosen:?} {notes:?}");
    }

    #[test]
    fn a_distance_out_of_reach_gets_the_highest_rung_and_a_note() {
        let targets = targets(&[Target::MaxDeviation(0.001)], 200);
        let (chosen, notes) = targets.choose(&targets.budgets(), &deviations(&[0.05, 0.02]));
        assert_eq!(chosen, [1]);
        assert_eq!(notes, ["MaxDeviation(0.001) is not met: a level of 177 faces has a deviation of 0.02"]);
    }
}
