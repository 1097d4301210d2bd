//! The mesh from which a candidate is collapsed, and the visible size of its faces.

use std::collections::HashMap;

use super::candidates::reconstruction;
use super::inputs::Inputs;
use super::visibility::{DIRECTIONS, FacePixels};
use super::{visibility, weld};
use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;

/// Rings of invisible faces that are kept around visible ones.
const KEPT_RINGS: usize = 2;
/// Least fraction of the pixels that backs of faces of two sides show, for which they become faces of their own where most
/// faces have one side.
const BACKS: f64 = 0.01;

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
        let double_sided = visibility::most_are_double_sided(&pixels.covered, |t| two_sided[t]);
        if remove_invisible && !double_sided && candidate == Candidate::Source {
            let seen = with_seen_backs(&mesh, &two_sided, |both| pixels_in_all_poses(inputs, both, &|_| false));
            (mesh, pixels) = seen.unwrap_or((mesh, pixels));
        }
        let covered = &pixels.covered;
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

/// A mesh with backs for its faces of two sides, and the pixels of faces of one side. `None` if the backs show next to nothing.
fn with_seen_backs(
    mesh: &TriMesh,
    two_sided: &[bool],
    pixels: impl Fn(&TriMesh) -> FacePixels,
) -> Option<(TriMesh, FacePixels)> {
    if !two_sided.contains(&true) {
        return None;
    }
    let both = with_backs(mesh, two_sided);
    let pixels = pixels(&both);
    let total = |pixels: &[u32]| pixels.iter().map(|&n| f64::from(n)).sum::<f64>();
    let of_backs = total(&pixels.covered[mesh.triangles.len()..]);
    (of_backs > BACKS * total(&pixels.covered)).then_some((both, pixels))
}

/// A mesh with a copy of each face of two sides, which shows its back.
fn with_backs(mesh: &TriMesh, two_sided: &[bool]) -> TriMesh {
    let (mut both, mut copies) = (mesh.clone(), HashMap::new());
    for (&triangle, _) in mesh.triangles.iter().zip(two_sided).filter(|(_, two)| **two) {
        let [a, b, c] = triangle.map(|v| {
            *copies.entry(v).or_insert_with(|| {
                both.positions.push(mesh.positions[v as usize]);
                both.positions.len() as u32 - 1
            })
        });
        both.triangles.push([a, c, b]);
    }
    both
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

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn backs_are_copies_with_vertices_of_their_own() {
        let mesh = TriMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE],
            triangles: vec![[0, 1, 2], [1, 3, 2], [0, 2, 3]],
        };
        let both = with_backs(&mesh, &[true, true, false]);
        assert_eq!((both.positions.len(), &both.triangles[..3]), (8, &mesh.triangles[..]));
        for (front, back) in [(0, 3), (1, 4)] {
            assert_eq!(both.area_vector(back), -both.area_vector(front));
        }
        assert!(both.triangles[3..].iter().flatten().all(|&v| v >= 4));
    }

    #[test]
    fn backs_that_are_seen_become_faces() {
        let square = |z: f32| [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y].map(|p| p + Vec3::Z * z);
        // A square that faces up, and closely below it one that faces down.
        let mesh = TriMesh {
            positions: [square(0.0), square(-0.001)].concat(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]],
        };
        let sphere = BoundingSphere::around(&mesh.positions);
        let pixels =
            |both: &TriMesh| visibility::visible_pixels(both, &sphere, 16, &|_| false, &crate::Cancellation::default());
        let single = TriMesh { triangles: mesh.triangles[..2].to_vec(), ..mesh.clone() };
        let (both, covered) = with_seen_backs(&single, &[true, true], pixels).expect("the back is seen from below");
        assert_eq!(both.triangles.len(), 4);
        assert!(covered.covered.iter().all(|&n| n > 0));
        assert!(with_seen_backs(&single, &[false, false], pixels).is_none(), "no face has two sides");
        assert!(with_seen_backs(&mesh, &[true; 4], pixels).is_none(), "the backs lie within");
    }
}
