//! The outcome of a bake.

use super::report::Report;
use crate::data::{Level, Model};

/// The outcome of [`bake`](crate::bake).
#[derive(Debug)]
pub struct Baked {
    /// A binary glTF: the source, and the levels behind it.
    pub glb: Vec<u8>,
    /// The levels, budgets ascending; empty unless baked.
    pub levels: Vec<Level>,
    /// The imported source, if it was imported.
    pub model: Option<Model>,
    /// The report of the bake.
    pub report: Report,
}
