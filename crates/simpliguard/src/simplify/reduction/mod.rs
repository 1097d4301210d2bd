//! Reduction: the source's own triangles, fewer of them, with the source's materials and texture coordinates.
//!
//! Where a budget is a good part of the source's triangles, most of them can stay as they are, and a texture that is baked
//! anew has less detail than the one that is there. So edges collapse onto one of their ends, where all attributes are known, or
//! into the place of the least error, with the attributes that suit the faces there best. What vertices carry is part of the
//! error (Garland and Heckbert 1998, Hoppe 1999), in units of length: a texture that slides by a millimetre counts as much as a
//! surface that moves by one. What moves by bones or morph targets has all its vertices from the source. Borders and seams are
//! held by planes of their own. Across a seam, a face keeps its own texture, whose coordinates are extrapolated.
//!
//! Other than the shapes of the competition, the result needs no atlas, no texture and no transfer of weights. It costs a draw
//! call for each material, and the textures of the source stay in use.

mod attributes;
mod collapse;
mod errors;
mod inputs;
mod pixels;
mod plan;
mod quadric;
mod reduced;
mod reducer;
#[cfg(test)]
mod tests;
mod wedges;

use glam::{DVec3, Vec3};

use super::face_weights::face_weights;
use super::shape::Shortfall;
use crate::data::{Morphs, Surface, TriMesh};
use crate::geometry::BoundingSphere;
use attributes::Scales;

use pixels::Pixels;
use reducer::{FaceWeights, Reducer};
use wedges::WedgeMesh;

pub use inputs::ReductionInputs;

/// Most morph targets whose full effect is a pose of its own for the error.
const MOST_MORPHS: usize = 16;

/// A reduced source.
#[derive(Clone, Debug)]
pub struct Reduced {
    /// Its vertices and triangles, with the materials of the source.
    pub surface: Surface,
    /// The reason if it has fewer faces than its budget.
    pub shortfall: Shortfall,
}

/// Reduces a source to each budget, ascending. Triangles are ordered by material, clear ones last, and within a material as in
/// the source. The meshes are manifolds. `None` where no triangle is left, and for all if cancelled.
pub fn reduce(inputs: &ReductionInputs<'_>, budgets: &[u32]) -> Vec<Option<Reduced>> {
    let sphere = BoundingSphere::around(&inputs.model.surface.positions);
    let scales = Scales::new(inputs.model, sphere.radius);
    let mut reducer = prepare(inputs, &sphere, &scales);
    let mut levels: Vec<Option<Reduced>> = Vec::with_capacity(budgets.len());
    for &budget in budgets.iter().rev() {
        let is_small = reducer.mesh.face_count() <= budget as usize;
        let shortfall = if is_small { Shortfall::VisibleFaces } else { Shortfall::Components };
        reducer.run(budget as usize);
        let fits = (1..=budget as usize).contains(&reducer.mesh.face_count()) && !inputs.cancellation.is_cancelled();
        let surface = || reduced::surface(inputs.model, &reducer.mesh, &sphere, &scales);
        levels.push(fits.then(|| Reduced { surface: surface(), shortfall }));
    }
    levels.reverse();
    levels
}

/// The source without the faces that nothing sees, ready to be reduced.
fn prepare<'a>(inputs: &ReductionInputs<'a>, sphere: &BoundingSphere, scales: &Scales<'_>) -> Reducer<'a> {
    let surface = &inputs.model.surface;
    let poses = posed_vertices(inputs);
    let pixels = Pixels::count(inputs, &poses);
    let hidden =
        if inputs.params.remove_invisible { pixels.hidden(inputs) } else { vec![false; surface.triangles.len()] };
    let kept: Vec<bool> = hidden.into_iter().map(|hidden| !hidden).collect();
    let mesh = WedgeMesh::new(inputs.model, scales, sphere, &kept);
    let unit = |p: Vec3| (p - sphere.centre).as_dvec3() / f64::from(sphere.radius);
    let pose = |positions: &Vec<Vec3>| mesh.vertices.iter().map(|&v| unit(positions[v as usize])).collect();
    let poses: Vec<Vec<DVec3>> = poses.iter().map(pose).collect();
    let weights = weights(inputs, &mesh, &pixels);
    Reducer::new(mesh, poses, weights, inputs.cancellation)
}

/// The weights of the faces by their visible size and their importance.
fn weights(inputs: &ReductionInputs<'_>, mesh: &WedgeMesh, pixels: &Pixels) -> FaceWeights {
    let positions = mesh.positions.iter().map(|p| p.as_vec3()).collect();
    let unit = TriMesh { positions, triangles: mesh.live().map(|f| mesh.points(f)).collect() };
    let of_faces = |of_triangles: &[u32]| -> Vec<f64> {
        let of_faces: Vec<u32> = mesh.source.iter().map(|&t| of_triangles[t as usize]).collect();
        let importance = |t: u32| inputs.importance.map_or(1.0, |all| f64::from(all.weights()[t as usize]));
        let weights = face_weights(&unit, &of_faces, inputs.params.visible_weight);
        weights.into_iter().zip(&mesh.source).map(|(weight, &t)| weight * importance(t)).collect()
    };
    FaceWeights { shape: of_faces(&pixels.weighted), attributes: of_faces(&pixels.covered) }
}

/// The positions of the source's vertices in the poses that decide, and under each of its first morph targets.
fn posed_vertices(inputs: &ReductionInputs<'_>) -> Vec<Vec<Vec3>> {
    let surface = &inputs.model.surface;
    let posed = inputs.poses.into_iter().flat_map(|poses| (0..poses.count()).map(|pose| poses.source_in(pose)));
    let targets = surface.morphs.iter().flat_map(|Morphs { targets, .. }| targets).take(MOST_MORPHS);
    let morphed = targets.map(|target| {
        let mut positions = surface.positions.clone();
        let by = 1.0 - target.weight;
        target.displacements.iter().for_each(|&(v, offset)| positions[v as usize] += offset * by);
        positions
    });
    posed.chain(morphed).collect()
}
