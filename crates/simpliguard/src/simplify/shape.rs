//! The result of the stage for one budget.

use std::{fmt, iter};

use crate::data::{Candidate, Cards, Deviation, TriMesh};

/// A mesh within a budget.
#[derive(Clone, Debug)]
pub struct Shape {
    /// The mesh, in world space.
    pub mesh: TriMesh,
    /// True if back faces are visible.
    pub double_sided: bool,
    /// The candidate that it came from.
    pub candidate: Candidate,
    /// Error against the views of the source that no texture removes: mean square per pixel.
    pub render_error: f64,
    /// Distances to the source, in the rest pose.
    pub deviation: Deviation,
    /// Number of self-intersecting faces.
    pub self_intersecting: usize,
    /// The reason if the mesh has fewer faces than its budget.
    pub shortfall: Shortfall,
    /// Faces that are cut-out cards, if the source is foliage.
    pub cards: Option<Cards>,
}

/// The shape for one budget, selected by its score.
#[derive(Clone, Debug)]
pub struct Selected {
    /// The best shape.
    pub best: Shape,
    /// The best of another kind.
    pub runner_up: Option<RunnerUp>,
}

/// The best shape of another kind than the selected one: a reconstruction instead of the source's own triangles, or the
/// source's own triangles instead of a reconstruction or of cards. Scores are estimates, and it may turn out better.
#[derive(Clone, Debug)]
pub struct RunnerUp {
    /// The shape.
    pub shape: Shape,
    /// Its score relative to that of the selected shape, usually 1 or more. Less is better.
    pub relative_score: f64,
}

impl Selected {
    /// Both shapes.
    pub fn shapes(&self) -> impl Iterator<Item = &Shape> {
        iter::once(&self.best).chain(self.runner_up.iter().map(|runner_up| &runner_up.shape))
    }

    pub(super) fn shapes_mut(&mut self) -> impl Iterator<Item = &mut Shape> {
        iter::once(&mut self.best).chain(self.runner_up.iter_mut().map(|runner_up| &mut runner_up.shape))
    }
}

impl Shape {
    /// A shape without faces.
    pub fn empty() -> Self {
        Self::unscored(TriMesh::default(), false, Candidate::Source, Shortfall::VisibleFaces)
    }

    /// A shape before it is scored.
    pub(super) fn unscored(mesh: TriMesh, double_sided: bool, candidate: Candidate, shortfall: Shortfall) -> Self {
        let (render_error, deviation) = (f64::INFINITY, Deviation::default());
        Self { mesh, double_sided, candidate, render_error, deviation, self_intersecting: 0, shortfall, cards: None }
    }
}

/// Reasons for a mesh with fewer faces than its budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shortfall {
    /// The mesh had no more faces before its collapse.
    VisibleFaces,
    /// Small components vanish as a whole.
    Components,
    /// Faces were kept free for joint planes that add fewer.
    JointPlanes,
    /// There are too few leaves for more cards.
    Leaves,
}

impl fmt::Display for Shortfall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::VisibleFaces => "the visible surface of the source has no more faces",
            Self::Components => {
                "small components vanish several faces at a time, and the next face would be one too many"
            }
            Self::JointPlanes => "faces were kept free for the joint planes, which add fewer",
            Self::Leaves => "there are too few leaves for more cards",
        })
    }
}
