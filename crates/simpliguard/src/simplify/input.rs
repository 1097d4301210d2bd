//! A candidate's mesh before its collapse, and who sees it.

use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;

use super::candidates::reconstruction;
use super::{Inputs, Params, visibility, weld};

/// Directions that a mesh in the rest pose is looked at from.
pub(super) const DIRECTIONS: usize = 48;
/// Rings of unseen faces kept around seen ones.
const RINGS: usize = 2;

/// A mesh before its collapse, and how many pixels see each face.
pub(super) struct SimplifyInput {
    pub(super) mesh: TriMesh,
    pub(super) pixels: Vec<u32>,
    /// Most of what is seen has two sides.
    pub(super) double_sided: bool,
}

/// Where a candidate begins, without the faces that nothing sees.
pub(super) fn input(inputs: &Inputs<'_>, params: &Params, candidate: Candidate) -> SimplifyInput {
    let opaque = inputs.opaque;
    let (mesh, two_sided): (TriMesh, Vec<bool>) = match candidate {
        Candidate::Reconstruction(p) => {
            let mesh = reconstruction::wrap(inputs, &p);
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
    };
    let pixels = visible_pixels(inputs, &mesh, &|t| two_sided[t]);
    let sided = pixels.iter().zip(&two_sided).filter(|(_, two)| **two).map(|(&n, _)| u64::from(n)).sum::<u64>();
    let double_sided = 2 * sided > pixels.iter().map(|&n| u64::from(n)).sum::<u64>();
    if !params.remove_invisible || pixels.iter().all(|&n| n == 0) || inputs.cancellation.is_cancelled() {
        return SimplifyInput { mesh, pixels, double_sided };
    }
    let mut seen: Vec<bool> = pixels.iter().map(|&n| n > 0).collect();
    visibility::grow(&mesh, &mut seen, RINGS);
    let kept = weld::cut(&mesh.filtered(|t| seen[t]));
    let pixels = pixels.iter().zip(&seen).filter(|(_, seen)| **seen).map(|(&n, _)| n).collect();
    SimplifyInput { mesh: kept, pixels, double_sided }
}

/// Pixels that see each face, at rest and, half as many, in motion.
fn visible_pixels(inputs: &Inputs<'_>, mesh: &TriMesh, double_sided: &(impl Fn(usize) -> bool + Sync)) -> Vec<u32> {
    let mut pixels = visibility::visible_pixels(mesh, &inputs.frame, DIRECTIONS, double_sided, inputs.cancellation);
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
        let frame = BoundingSphere::around(&posed.positions);
        let seen = visibility::visible_pixels(&posed, &frame, directions, double_sided, inputs.cancellation);
        pixels.iter_mut().zip(seen).for_each(|(sum, n)| *sum += n);
    }
    pixels
}

/// Area of each face, scaled by how many pixels see its surroundings per area, in the mean one.
pub(super) fn face_weights(mesh: &TriMesh, pixels: &[u32], visible: f64) -> Vec<f64> {
    let areas: Vec<f64> = (0..mesh.triangles.len()).map(|t| 0.5 * f64::from(mesh.area_vector(t).length())).collect();
    let area: f64 = areas.iter().sum();
    let total: f64 = pixels.iter().map(|&n| f64::from(n)).sum();
    if total == 0.0 || area == 0.0 {
        return areas;
    }
    // Pixels and area around each vertex: a face between two pixels is not weightless.
    let mut around = vec![(0.0, 0.0); mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for &v in triangle {
            around[v as usize].0 += f64::from(pixels[t]) / total;
            around[v as usize].1 += areas[t] / area;
        }
    }
    let density = |v: u32| around[v as usize].0 / around[v as usize].1.max(1e-12);
    let mean = |t: &[u32; 3]| t.iter().map(|&v| density(v)).sum::<f64>() / 3.0;
    mesh.triangles.iter().zip(&areas).map(|(t, &a)| a * ((1.0 - visible) + visible * mean(t))).collect()
}
