//! Generators of candidates.

pub(super) mod cards;
pub(super) mod reconstruction;
