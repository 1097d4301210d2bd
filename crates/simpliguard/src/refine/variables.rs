//! The variables of the optimisation, and their best values so far.

use glam::{Vec3, Vec4};

use super::low_poly::LowPoly;
use super::skin::Skin;

/// A level's mesh and texture and, if the level moves, its skin weights.
pub(super) struct Variables<'a, 'p> {
    pub(super) low: &'a mut LowPoly,
    pub(super) skin: Option<&'a mut Skin<'p>>,
}

impl Variables<'_, '_> {
    /// Brings the motions of the mesh into `pose` up to date with the skin weights.
    pub(super) fn update_motions(&mut self, pose: Option<usize>) {
        if let Some(skin) = &self.skin {
            skin.move_into(pose, self.low);
        }
    }

    /// Brings all motions of the mesh up to date with the skin weights.
    pub(super) fn update_all_motions(&mut self) {
        if let Some(skin) = &self.skin {
            skin.move_into_all(self.low);
        }
    }
}

/// The best iterate so far.
pub(super) struct BestIterate {
    /// Its PSNR over the validation views, in dB.
    pub(super) psnr: f32,
    positions: Vec<Vec3>,
    texels: Vec<Vec4>,
    weights: Vec<[f32; 4]>,
}

impl BestIterate {
    /// The variables as they are.
    pub(super) fn new(psnr: f32, variables: &Variables<'_, '_>) -> Self {
        let weights = variables.skin.as_deref().map_or_else(Vec::new, Skin::weights);
        let LowPoly { positions, texture, .. } = &*variables.low;
        Self { psnr, positions: positions.clone(), texels: texture.texels.clone(), weights }
    }

    /// Sets the variables back to this iterate.
    pub(super) fn restore(&self, variables: &mut Variables<'_, '_>) {
        variables.low.positions.clone_from(&self.positions);
        variables.low.texture.texels.clone_from(&self.texels);
        if let Some(skin) = &mut variables.skin {
            skin.set_weights(&self.weights);
        }
        variables.update_all_motions();
    }
}
