//! The inputs of a reduction.

use crate::Cancellation;
use crate::animation::Poses;
use crate::data::Model;
use crate::simplify::importance::Importance;
use crate::simplify::params::CollapseParams;

/// What a reduction reads.
pub struct ReductionInputs<'a> {
    /// The whole source.
    pub model: &'a Model,
    /// Poses from its clips; `None` if it does not move.
    pub poses: Option<&'a Poses<'a>>,
    /// Weights of its triangles; `None` if all count alike.
    pub importance: Option<&'a Importance>,
    /// Weights and removal of faces.
    pub params: &'a CollapseParams,
    /// Ends the work early.
    pub cancellation: &'a Cancellation,
}
