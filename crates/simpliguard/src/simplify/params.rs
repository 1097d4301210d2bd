//! How to find shapes.

use crate::data::Reconstruction;
use crate::settings::{BakeSettings, Candidates, Resolution};
use crate::skinning::JointPlane;

/// Cells of the reconstructions that `Resolution::Auto` begins with.
const COARSE: u32 = 128;
const FINE: u32 = 256;

/// How to find the shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Face budgets, ascending.
    pub budgets: Vec<u32>,
    /// The reconstruction that is always tried, if any is.
    pub reconstruction: Option<Reconstruction>,
    /// Tried unless the source's own triangles serve as well as the first.
    pub fine: Option<Reconstruction>,
    /// Tried only where parts lie close together.
    pub thick: Option<Reconstruction>,
    /// Tried only where the best shape passes through itself.
    pub finer: Option<Reconstruction>,
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
        let finest = settings.finest_resolution;
        let reconstruction = match (settings.candidates, settings.resolution) {
            (Candidates::Source, _) => None,
            (_, Resolution::Auto) => Some(Reconstruction::new(finest.min(COARSE))),
            (_, Resolution::Cells(n)) => Some(Reconstruction::new(n)),
        };
        // Coarse suits small budgets, fine large ones.
        let further = |p| (settings.resolution == Resolution::Auto && reconstruction.is_some()).then_some(p);
        let beyond = |cells, p: Reconstruction| further(p).filter(|p| p.resolution > cells);
        Self {
            budgets: budgets.to_vec(),
            reconstruction,
            fine: beyond(COARSE, Reconstruction::new(finest.min(FINE))),
            thick: further(Reconstruction::thick(finest.min(COARSE))),
            finer: beyond(FINE, Reconstruction::new(finest)),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_reconstruction_is_finer_than_wanted() {
        let cells = |finest_resolution: u32| {
            let params = Params::new(&BakeSettings { finest_resolution, ..BakeSettings::default() }, &[1000]);
            [params.reconstruction, params.fine, params.finer].map(|p| p.map(|p| p.resolution))
        };
        assert_eq!(cells(384), [Some(128), Some(256), Some(384)]);
        assert_eq!(cells(256), [Some(128), Some(256), None]);
        assert_eq!(cells(200), [Some(128), Some(200), None]);
        assert_eq!(cells(64), [Some(64), None, None]);
        let fixed = BakeSettings { resolution: Resolution::Cells(64), ..BakeSettings::default() };
        assert_eq!(Params::new(&fixed, &[1000]).fine, None);
    }
}
