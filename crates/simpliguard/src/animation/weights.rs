//! Weights of one vertex over any number of bones.

use crate::data::Influences;

/// Smallest weight relative to the largest one of a vertex; smaller ones are noise of the interpolation and are
/// dropped.
const NEGLIGIBLE: f32 = 1e-4;

/// A sparse sum of influences, ascending by joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Weights(Vec<(u16, f32)>);

impl Weights {
    /// Adds a multiple of a vertex's influences.
    pub(crate) fn add(&mut self, influences: &Influences, factor: f32) {
        for (&joint, &weight) in influences.joints.iter().zip(&influences.weights) {
            if weight > 0.0 {
                self.add_joint(joint, weight * factor);
            }
        }
    }

    /// Adds to the weight of one joint.
    pub(crate) fn add_joint(&mut self, joint: u16, weight: f32) {
        match self.0.binary_search_by_key(&joint, |(j, _)| *j) {
            Ok(at) => self.0[at].1 += weight,
            Err(at) => self.0.insert(at, (joint, weight)),
        }
    }

    /// The weight of a joint; zero if it has none.
    pub(crate) fn of(&self, joint: u16) -> f32 {
        self.0.binary_search_by_key(&joint, |(j, _)| *j).map_or(0.0, |at| self.0[at].1)
    }

    /// The joints with an entry, ascending.
    pub(crate) fn joints(&self) -> impl Iterator<Item = u16> {
        self.0.iter().map(|(j, _)| *j)
    }

    /// The four largest weights in falling order, scaled to a sum of one; of equal weights the lower joint first. Joint
    /// 0 has all the weight if there is none.
    pub(crate) fn strongest(&self) -> Influences {
        let mut all: Vec<(u16, f32)> = self.0.iter().copied().filter(|(_, w)| w.is_finite() && *w > 0.0).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let Some(&(_, largest)) = all.first() else { return Influences::rigid(0) };
        all.truncate(4);
        all.retain(|(_, w)| *w > NEGLIGIBLE * largest);
        let sum: f32 = all.iter().map(|(_, w)| w).sum();
        let mut out = Influences::default();
        for (i, (joint, weight)) in all.into_iter().enumerate() {
            out.joints[i] = joint;
            out.weights[i] = weight / sum;
        }
        out
    }
}

/// The influences at the fraction `t` between `a` and `b`.
pub(crate) fn blended(a: &Influences, b: &Influences, t: f32) -> Influences {
    let mut weights = Weights::default();
    weights.add(a, 1.0 - t);
    weights.add(b, t);
    weights.strongest()
}

/// The same influences with their weights in falling order, none negligible, scaled to a sum of one.
pub(crate) fn ordered(influences: &Influences) -> Influences {
    let mut weights = Weights::default();
    weights.add(influences, 1.0);
    weights.strongest()
}

/// Projects weights onto the probability simplex: the closest point with coordinates of at least zero that sum to one
/// (Duchi et al. 2008).
pub(crate) fn project(weights: &mut [f32]) {
    let mut falling = weights.to_vec();
    falling.sort_by(|a, b| b.total_cmp(a));
    let mut sum = 0.0;
    let mut shift = 0.0;
    for (k, weight) in falling.into_iter().enumerate() {
        sum += weight;
        let next = (sum - 1.0) / (k + 1) as f32;
        if weight - next > 0.0 {
            shift = next;
        }
    }
    weights.iter_mut().for_each(|w| *w = (*w - shift).max(0.0));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_off_the_simplex_goes_to_its_nearest_point() {
        for (mut weights, expected) in [
            ([0.5, 0.5, 0.5], [1.0 / 3.0; 3]),
            ([1.25, 0.25, -0.5], [1.0, 0.0, 0.0]),
            ([0.7, 0.5, -0.6], [0.6, 0.4, 0.0]),
            ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]),
        ] {
            project(&mut weights);
            assert!(weights.iter().zip(expected).all(|(w, e)| (w - e).abs() < 1e-6), "{weights:?} {expected:?}");
        }
    }

    #[test]
    fn the_four_largest_stay_and_fall() {
        let mut weights = Weights::default();
        for (joint, weight) in [(9, 0.125), (4, 0.25), (7, 0.0625), (2, 0.25), (5, 0.375)] {
            weights.add_joint(joint, weight);
        }
        assert_eq!(weights.strongest(), Influences { joints: [5, 2, 4, 9], weights: [0.375, 0.25, 0.25, 0.125] });
    }

    #[test]
    fn nothing_and_poison_end_up_on_the_first_joint() {
        let mut weights = Weights::default();
        assert_eq!(weights.strongest(), Influences::rigid(0));
        weights.add_joint(3, f32::NAN);
        assert_eq!(weights.strongest(), Influences::rigid(0));
    }
}
