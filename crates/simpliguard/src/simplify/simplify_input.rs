//! The mesh from which a candidate is collapsed, and the visible size of its faces.

use super::candidates::reconstruction;
use super::inputs::Inputs;
use super::visibility::{DIRECTIONS, FacePixels};
use super::{visibility, weld};
use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;

/// Rings of invisible faces that are kept around visible ones.
const KEPT_RINGS: usize = 2;

/// A mesh before its collapse, and the visible size of its faces.
pub(super) struct SimplifyInput {
    pub(super) mesh: TriMesh,
    /// Number of pixels that each face covers, over all views. Those on outlines count many times.
    pub(super) pixels: Vec<u32>,
    /// True if double-sided faces cover more than half of the pixels.
    pub(super) double_sided: bool,
    /// Faces hide nothing behind them.
    pub(super) is_clear: bool,
}

impl SimplifyInput {
    /// The mesh of a candidate. `remove_invisible` removes the faces that no view sees.
    pub(super) fn of(inputs: &Inputs<'_>, remove_invisible: bool, candidate: Candidate) -> Self {
        let (mut mesh, mut two_sided) = candidate_mesh(inputs, candidate);
        let mut pixels = pixels_in_all_poses(inputs, &mesh, &|t| two_sided[t]);
        if let (Candidate::Reconstruction(params), true) = (candidate, remove_invisible)
            && let Some(open) = reconstruction::seen_through_backs(inputs, &params, &mesh, &pixels.covered)
        {
            two_sided = vec![false; open.triangles.len()];
            pixels = pixels_in_all_poses(inputs, &open, &|_| false);
            mesh = open;
        }
        let covered = &pixels.covered;
        let double = covered.iter().zip(&two_sided).filter(|(_, two)| **two).map(|(&n, _)| u64::from(n)).sum::<u64>();
        let double_sided = 2 * double > covered.iter().map(|&n| u64::from(n)).sum::<u64>();
        let weighted = pixels.weighted();
        if !remove_invisible || covered.iter().all(|&n| n == 0) || inputs.cancellation.is_cancelled() {
            return Self { mesh, pixels: weighted, double_sided, is_clear: false };
        }
        let mut kept: Vec<bool> = covered.iter().map(|&n| n > 0).collect();
        visibility::grow(&mesh, &mut kept, KEPT_RINGS);
        let visible = weld::cut(&mesh.filtered(|t| kept[t]));
        let pixels = weighted.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(&n, _)| n).collect();
        Self { mesh: visible, pixels, double_sided, is_clear: false }
    }
}

/// The mesh of a candidate, and for each face if it has two sides.
fn candidate_mesh(inputs: &Inputs<'_>, candidate: Candidate) -> (TriMesh, Vec<bool>) {
    let opaque = inputs.opaque;
    match candidate {
        Candidate::Reconstruction(params) => {
            let mesh = reconstruction::reconstruct(inputs, &params);
            let faces = mesh.triangles.len();
            (mesh, vec![false; faces])
        }
        // Cards begin with the source's own triangles.
        Candidate::Source | Candidate::Cards => {
            let (mesh, welded_from) = weld::weld_patches(&opaque.mesh.positions, &opaque.mesh.triangles);
            let two_sided =
                welded_from.iter().map(|&t| inputs.model.material_of(opaque.source[t as usize]).double_sided);
            (mesh, two_sided.collect())
        }
    }
}

/// The pixels of each face: in the rest pose and, from half as many directions, in the other poses.
pub(super) fn pixels_in_all_poses(
    inputs: &Inputs<'_>,
    mesh: &TriMesh,
    double_sided: &(impl Fn(usize) -> bool + Sync),
) -> FacePixels {
    let mut pixels = visibility::visible_pixels(mesh, &inputs.sphere, DIRECTIONS, double_sided, inputs.cancellation);
    let Some(poses) = inputs.poses else { return pixels };
    let directions = (DIRECTIONS / 2).div_ceil(poses.count());
    for posed in poses.posed(mesh, &poses.motions_by_closest_point(inputs.bvh, &mesh.positions)) {
        let sphere = BoundingSphere::around(&posed.positions);
        pixels.add(&visibility::visible_pixels(&posed, &sphere, directions, double_sided, inputs.cancellation));
    }
    pixels
}
