//! The bones of a vertex, from any number of joints and weights.

use super::schema::Primitive;
use crate::data::Influences;

/// Weights below this fraction of a vertex's largest are dropped.
const NEGLIGIBLE: f32 = 1e-6;

/// True if a primitive has the attributes that bind it to a skin.
pub(super) fn has_joints(primitive: &Primitive<'_>) -> bool {
    primitive.attributes.contains_key("JOINTS_0") && primitive.attributes.contains_key("WEIGHTS_0")
}

/// The four largest weights, after weights on the same bone are added up: descending, equal ones by bone, sum one.
/// `None` if no weight is positive.
pub(super) fn influences(pairs: impl Iterator<Item = (u16, f32)>) -> Option<Influences> {
    let mut merged: Vec<(u16, f32)> = Vec::with_capacity(8);
    for (joint, weight) in pairs.filter(|(_, weight)| weight.is_finite() && *weight > 0.0) {
        match merged.iter_mut().find(|(known, _)| *known == joint) {
            Some((_, sum)) => *sum += weight,
            None => merged.push((joint, weight)),
        }
    }
    merged.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    merged.truncate(4);
    let least = merged.first().map_or(0.0, |largest| largest.1 * NEGLIGIBLE);
    merged.retain(|(_, weight)| *weight >= least);
    let sum: f32 = merged.iter().map(|(_, weight)| weight).sum();
    if !(sum.is_finite() && sum > 0.0) {
        return None;
    }
    let mut out = Influences::default();
    for (k, (joint, weight)) in merged.into_iter().enumerate() {
        (out.joints[k], out.weights[k]) = (joint, weight / sum);
    }
    Some(out)
}
