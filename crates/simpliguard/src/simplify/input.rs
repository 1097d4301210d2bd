//! The mesh that a candidate is collapsed from, and the visible size of its faces.

use super::candidates::reconstruction;
use super::inputs::Inputs;
use super::{visibility, weld};
use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;

/// Directions that a mesh in the rest pose is looked at from.
pub(super) const DIRECTIONS: usize = 48;
/// Rings of unseen faces kept around seen ones.
const RINGS: usize = 2;

/// A mesh before its collapse, and how many pixels see each face.
pub(super) struct SimplifyInput {
    pub(super) mesh: TriMesh,
    pub(super) pixels: Vec<u32>,
    /// Most of the visible faces are double sided.
    pub(super) double_sided: bool,
}

impl SimplifyInput {
    /// The mesh of a candidate. With `remove_invisible`, without the faces that nothing sees.
    pub(super) fn of(inputs: &Inputs<'_>, remove_invisible: bool, candidate: Candidate) -> Self {
        let (mesh, two_sided) = surface(inputs, candidate);
        let pixels = visible_pixels(inputs, &mesh, &|t| two_sided[t]);
        let sided = pixels.iter().zip(&two_sided).filter(|(_, two)| **two).map(|(&n, _)| u64::from(n)).sum::<u64>();
        let double_sided = 2 * sided > pixels.iter().map(|&n| u64::from(n)).sum::<u64>();
        if !remove_invisible || pixels.iter().all(|&n| n == 0) || inputs.cancellation.is_cancelled() {
            return Self { mesh, pixels, double_sided };
        }
        let mut seen: Vec<bool> = pixels.iter().map(|&n| n > 0).collect();
        visibility::grow(&mesh, &mut seen, RINGS);
        let kept = weld::cut(&mesh.filtered(|t| seen[t]));
        let pixels = pixels.iter().zip(&seen).filter(|(_, seen)| **seen).map(|(&n, _)| n).collect();
        Self { mesh: kept, pixels, double_sided }
    }
}

/// The mesh of a candidate, and the faces that have two sides.
fn surface(inputs: &Inputs<'_>, candidate: Candidate) -> (TriMesh, Vec<bool>) {
    let opaque = inputs.opaque;
    match candidate {
        Candidate::Reconstruction(params) => {
            let mesh = reconstruction::wrap(inputs, &params);
            let faces = mesh.triangles.len();
            (mesh, vec![false; faces])
        }
        // Cards begin with the source's own triangles.
        Candidate::Source | Candidate::Cards => {
            let (mesh, welded_from) = weld::weld(&opaque.mesh.positions, &opaque.mesh.triangles);
            let two_sided =
                welded_from.iter().map(|&t| inputs.model.material_of(opaque.source[t as usize]).double_sided);
            (mesh, two_sided.collect())
        }
    }
}

/// Pixels that see each face, at rest and, half as many, in motion.
fn visible_pixels(inputs: &Inputs<'_>, mesh: &TriMesh, double_sided: &(impl Fn(usize) -> bool + Sync)) -> Vec<u32> {
    let mut pixels = visibility::visible_pixels(mesh, &inputs.sphere, DIRECTIONS, double_sided, inputs.cancellation);
    let moving = pixels_in_motion(inputs, mesh, double_sided);
    pixels.iter_mut().zip(moving).for_each(|(sum, n)| *sum += n);
    pixels
}

/// Pixels that see each face in the poses, from half as many directions as at rest over all of them.
pub(super) fn pixels_in_motion(
    inputs: &Inputs<'_>,
    mesh: &TriMesh,
    double_sided: &(impl Fn(usize) -> bool + Sync),
) -> Vec<u32> {
    let mut pixels = vec![0; mesh.triangles.len()];
    let Some(poses) = inputs.poses else { return pixels };
    let directions = (DIRECTIONS / 2).div_ceil(poses.count());
    for posed in poses.posed(mesh, &poses.motions_by_closest_point(inputs.bvh, &mesh.positions)) {
        let sphere = BoundingSphere::around(&posed.positions);
        let seen = visibility::visible_pixels(&posed, &sphere, directions, double_sided, inputs.cancellation);
        pixels.iter_mut().zip(seen).for_each(|(sum, n)| *sum += n);
    }
    pixels
}
