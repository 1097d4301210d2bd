//! Candidates that are more than the source's own triangles: reconstructions and cards.

pub(super) mod cards;
mod leaf_groups;
pub(super) mod reconstruction;
