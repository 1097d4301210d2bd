//! How to find shapes.

use crate::reconstruct;
use crate::rig::JointPlane;
use crate::settings::{BakeSettings, Candidates, Resolution};

/// How to find the shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Face budgets, ascending.
    pub budgets: Vec<u32>,
    /// Reconstructions to try.
    pub reconstructions: Vec<reconstruct::Params>,
    /// Tried only where the best shape passes through itself.
    pub finer: Option<reconstruct::Params>,
    /// Whether to try the source's own triangles.
    pub source: bool,
    /// Whether foliage becomes cards.
    pub cards: bool,
    /// Faces that nothing sees are dropped.
    pub remove_invisible: bool,
    /// Part of a face's quadric weight that comes from how large it appears rather than from its area, 0 to 1.
    pub visible_weight: f64,
    /// Weight of the curvature constraint (alpha in the paper).
    pub curvature: f64,
    /// Planes that faces are kept for, and split along.
    pub joint_planes: JointPlanes,
}

impl Params {
    /// What the settings ask for, without joint planes.
    pub fn new(settings: &BakeSettings, budgets: &[u32]) -> Self {
        let reconstructions = match (settings.candidates, settings.resolution) {
            (Candidates::Source, _) => Vec::new(),
            // Fine for large budgets, coarse for small ones, thick where parts lie close together.
            (_, Resolution::Auto) => {
                vec![reconstruct::Params::new(128), reconstruct::Params::new(256), reconstruct::Params::thick(128)]
            }
            (_, Resolution::Cells(n)) => vec![reconstruct::Params::new(n)],
        };
        Self {
            budgets: budgets.to_vec(),
            finer: (settings.resolution == Resolution::Auto && !reconstructions.is_empty())
                .then(|| reconstruct::Params::new(384)),
            reconstructions,
            // The source's own triangles need not be closed.
            source: settings.candidates != Candidates::Reconstruction && !settings.watertight,
            cards: settings.candidates == Candidates::All && !settings.watertight,
            remove_invisible: settings.remove_invisible && !settings.watertight,
            visible_weight: f64::from(settings.visible_weight),
            curvature: f64::from(settings.curvature),
            joint_planes: JointPlanes::default(),
        }
    }
}

/// Planes along which a shape is split once it is made, within its budget.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointPlanes {
    /// The planes, the most important first.
    pub planes: Vec<JointPlane>,
    /// The shape is split at once; if not, it has as many faces less, for a later stage to split.
    pub split: bool,
}
