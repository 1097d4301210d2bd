//! Candidates that are more than the source's own triangles: reconstructions and cards.

pub(super) mod cards;
pub(super) mod reconstruction;
