//! Parameters of the stage.

use serde::Serialize;

use crate::data::{Candidate, Reconstruction};

/// Parameters of the whole stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SimplifyParams {
    /// Face budgets, ascending.
    pub budgets: Vec<u32>,
    /// Candidates that compete.
    pub candidates: CandidateParams,
    /// The collapse of each candidate.
    pub collapse: CollapseParams,
}

/// Candidates that compete for each budget.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CandidateParams {
    /// The reconstruction that is always generated, if any is.
    pub reconstruction: Option<Reconstruction>,
    /// Generated unless the source's own triangles score as well as the first reconstruction.
    pub fine: Option<Reconstruction>,
    /// Generated only if components of the source lie close together.
    pub thick: Option<Reconstruction>,
    /// Generated only if the best shape intersects itself.
    pub finer: Option<Reconstruction>,
    /// The source's own triangles compete.
    pub source: bool,
    /// Foliage becomes cards.
    pub cards: bool,
}

impl CandidateParams {
    /// The quick candidates, which are always generated.
    pub fn first(&self) -> impl Iterator<Item = Candidate> {
        let source = self.source.then_some(Candidate::Source);
        self.reconstruction.map(Candidate::Reconstruction).into_iter().chain(source)
    }

    /// All candidates that may be generated, the quick ones first.
    pub fn all(&self) -> impl Iterator<Item = Candidate> {
        let further = [self.fine, self.thick, self.finer].into_iter().flatten();
        let cards = self.cards.then_some(Candidate::Cards);
        self.first().chain(further.map(Candidate::Reconstruction)).chain(cards)
    }
}

/// The collapse of a candidate to the budgets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CollapseParams {
    /// Faces that no view sees are removed.
    pub remove_invisible: bool,
    /// Fraction of a face's quadric weight that comes from its visible size and not from its area, 0 to 1.
    pub visible_weight: f64,
    /// Weight of the curvature constraint (alpha in the paper).
    pub curvature: f64,
    /// Sum of angles around a vertex at which its curvature is a half, in radians; `None` without the constraint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub curvature_angle: Option<f64>,
    /// Random rays from each vertex of a finished shape, whose faces without a ray that leaves are removed; 0 keeps all.
    #[serde(skip_serializing_if = "is_zero")]
    pub invisible_rays: u32,
    /// Faces are split along the joint planes at once. Otherwise as many faces are kept free in the budget.
    pub split_at_joints: bool,
}

/// Left out of the keys, so that shapes of earlier bakes are found.
fn is_zero(number: &u32) -> bool {
    *number == 0
}
