//! The skin of a level: transfer, bone remap and fit, one after another.

use super::bone_remap::BoneRemap;
use super::closest_surface::{MAX_ANGLE, MAX_DISTANCE, MatchLimits};
use super::fit::fit;
use super::skin_source::SkinSource;
use super::transfer::{Transfer, transfer};
use crate::animation::Poses;
use crate::data::{Influences, TriMesh};

/// Parameters of the skin of a level.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SkinningParams {
    /// The method of transfer.
    pub transfer: Transfer,
    /// Joints that move fewer faces of a level are replaced by the joint above; 0 keeps all.
    pub bone_faces: f32,
    /// Weights are fitted to the poses.
    pub fit_weights: bool,
}

/// Influences of each vertex of a level in the rest pose: transferred from the source, moved to the bones that are
/// kept, and fitted to the poses. Empty for a model without bones.
pub fn skin(
    source: &SkinSource<'_>,
    poses: Option<&Poses<'_>>,
    mesh: &TriMesh,
    params: &SkinningParams,
) -> Vec<Influences> {
    let (mut influences, _) = transfer(source, mesh, &mesh.vertex_normals(), params.transfer);
    if let Some(remap) = BoneRemap::of(source.model, mesh.triangles.len(), params.bone_faces) {
        remap.apply(&mut influences);
    }
    match poses {
        Some(poses) if params.fit_weights => {
            let limits = MatchLimits::new(source.model, MAX_DISTANCE, MAX_ANGLE);
            fit(source, poses, mesh, influences, limits)
        }
        _ => influences,
    }
}
