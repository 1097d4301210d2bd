//! From a candidate's mesh down to the budgets.

use glam::{Affine3A, Vec3};

use super::input::{SimplifyInput, face_weights, pixels_in_motion};
use super::qem::Simplifier;
use super::select::MAY_INTERSECT;
use super::{Inputs, JointPlanes, Params, Shape, self_intersecting_faces, visibility};
use crate::animation::{Motions, Poses};
use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;
use crate::skinning::{self};

/// Faces kept, as a multiple of the largest budget, when enclosed faces are looked for.
const ENCLOSED_AT: usize = 4;
/// A component that deserves fewer faces than this is dropped.
const NEGLIGIBLE_FACES: f64 = 0.75;
/// Largest part of a budget that is kept for the faces along joint planes.
const MOST_RESERVED: f64 = 0.08;
/// Depth of contacts that are resolved as a part of the mean edge, and where that is not enough.
const SHALLOW: f64 = 0.1;
const DEEP: f64 = 0.5;
/// Part of the faces up to which the latter may be enough.
const NEARLY_CLEAN: f64 = 0.06;

/// Collapses a mesh to each budget; some candidates offer several shapes, the second for each behind the first for all.
pub(super) fn simplify_to_budgets(
    inputs: &Inputs<'_>,
    params: &Params,
    candidate: Candidate,
    input: &SimplifyInput,
) -> Vec<Shape> {
    let Some(simplifier) = before_the_budgets(inputs, params, input) else { return Vec::new() };
    let down = |depth| down_to_budgets(simplifier.clone(), inputs, params, candidate, input.double_sided, depth);
    let self_intersecting = self_intersecting_fraction(&simplifier.mesh()) > MAY_INTERSECT;
    let (apart, freely) = rayon::join(|| down(Some(SHALLOW)), || self_intersecting.then(|| down(None)));
    let Descent { mut shapes, is_stuck } = apart;
    if shapes
        .iter()
        .map(|shape| self_intersecting_fraction(&shape.mesh))
        .any(|part| part > MAY_INTERSECT && part < NEARLY_CLEAN)
    {
        shapes.extend(down(Some(DEEP)).shapes);
    }
    // Parts that pass through each other, and two sides of a thin sheet, may fare better where each goes its own way.
    let freely = freely.or_else(|| is_stuck.then(|| down(None)));
    shapes.extend(freely.into_iter().flat_map(|descent| descent.shapes));
    shapes
}

/// The mesh without what nothing sees, a few times as large as the largest budget; `None` if cancelled.
fn before_the_budgets(inputs: &Inputs<'_>, params: &Params, input: &SimplifyInput) -> Option<Simplifier> {
    let is_cancelled = || inputs.cancellation.is_cancelled();
    let unit = to_unit_sphere(&input.mesh, &inputs.frame);
    let mut weights = face_weights(&unit, &input.pixels, params.visible_weight);
    if let Some(importance) = inputs.importance {
        let factors = importance.of_faces(&input.mesh, inputs.bvh);
        weights.iter_mut().zip(factors).for_each(|(weight, factor)| *weight *= factor);
    }
    if is_cancelled() {
        return None;
    }
    let mut simplifier = Simplifier::new(&unit, &weights, params.curvature);
    simplifier.stop_with(inputs.cancellation);
    let largest = params.budgets.last().copied().unwrap_or(0) as usize;
    if params.remove_invisible {
        simplifier.drop_negligible_components(largest, NEGLIGIBLE_FACES);
        simplifier.run(ENCLOSED_AT * largest);
        if is_cancelled() {
            return None;
        }
        simplifier.remove_faces(&enclosed(inputs, &simplifier.mesh(), input.double_sided));
    } else if inputs.poses.is_some() {
        simplifier.run(ENCLOSED_AT * largest);
    }
    if let Some(poses) = inputs.poses {
        simplifier.follow(poses.count(), |unit| motions_in_unit_sphere(inputs, poses, unit));
    }
    (!is_cancelled()).then_some(simplifier)
}

/// Shapes that one mesh was collapsed to.
struct Descent {
    /// One per budget, in their order.
    shapes: Vec<Shape>,
    /// A budget could only be met by more faces that cross.
    is_stuck: bool,
}

/// Collapses to each budget, the largest first. `depth` is how deep contacts are resolved on the way, as a part of the
/// mean edge; with `None` faces may pass through each other.
fn down_to_budgets(
    mut simplifier: Simplifier,
    inputs: &Inputs<'_>,
    params: &Params,
    candidate: Candidate,
    double_sided: bool,
    depth: Option<f64>,
) -> Descent {
    let resolve_intersections =
        |simplifier: &mut Simplifier| depth.into_iter().for_each(|deepest| simplifier.resolve_intersections(deepest));
    resolve_intersections(&mut simplifier);
    let mut shapes = Vec::new();
    for &budget in params.budgets.iter().rev().take_while(|_| !inputs.cancellation.is_cancelled()) {
        if params.remove_invisible {
            simplifier.drop_negligible_components(budget as usize, NEGLIGIBLE_FACES);
        }
        simplifier.run(budget as usize);
        resolve_intersections(&mut simplifier);
        let mesh = with_joint_planes(&simplifier, inputs, &params.joint_planes, budget as usize);
        shapes.push(Shape::unjudged(mesh, double_sided, candidate, None));
    }
    shapes.reverse();
    Descent { shapes, is_stuck: simplifier.is_stuck() }
}

/// What the simplifier has come down to, split along the joint planes within the budget: it goes further down by as many
/// faces as they add.
fn with_joint_planes(simplifier: &Simplifier, inputs: &Inputs<'_>, wanted: &JointPlanes, budget: usize) -> TriMesh {
    let mesh = from_unit_sphere(simplifier.mesh(), &inputs.frame);
    if wanted.planes.is_empty() {
        return mesh;
    }
    let split = |mesh: &TriMesh, most: usize| {
        skinning::split_along(inputs.model, mesh, &inputs.influences(mesh), &wanted.planes, most).mesh
    };
    let most = mesh.triangles.len() + (MOST_RESERVED * budget as f64) as usize;
    let reserved = split(&mesh, most).triangles.len() - mesh.triangles.len();
    let mut lower = simplifier.clone();
    lower.run(budget - reserved);
    let mesh = from_unit_sphere(lower.mesh(), &inputs.frame);
    if wanted.split { split(&mesh, budget) } else { mesh }
}

/// Motions of points in the unit sphere, there.
fn motions_in_unit_sphere(inputs: &Inputs<'_>, poses: &Poses<'_>, unit: &[Vec3]) -> Motions {
    let BoundingSphere { centre, radius } = inputs.frame;
    let positions: Vec<Vec3> = unit.iter().map(|p| *p * radius + centre).collect();
    let from_unit = Affine3A::from_translation(centre) * Affine3A::from_scale(Vec3::splat(radius));
    poses.motions_by_closest_point(inputs.bvh, &positions).rebased(from_unit)
}

pub(super) fn to_unit_sphere(mesh: &TriMesh, frame: &BoundingSphere) -> TriMesh {
    let positions = mesh.positions.iter().map(|p| (*p - frame.centre) / frame.radius).collect();
    TriMesh { positions, triangles: mesh.triangles.clone() }
}

pub(super) fn from_unit_sphere(mesh: TriMesh, frame: &BoundingSphere) -> TriMesh {
    let positions = mesh.positions.iter().map(|p| *p * frame.radius + frame.centre).collect();
    TriMesh { positions, triangles: mesh.triangles }
}

/// Which faces of a mesh in the unit sphere nothing sees: no camera in motion, and no ray from them at rest gets out.
fn enclosed(inputs: &Inputs<'_>, unit: &TriMesh, double_sided: bool) -> Vec<bool> {
    let mesh = from_unit_sphere(unit.clone(), &inputs.frame);
    let mut enclosed: Vec<bool> =
        pixels_in_motion(inputs, &mesh, &|_| double_sided).into_iter().map(|pixels| pixels == 0).collect();
    let frame = BoundingSphere { centre: Vec3::ZERO, radius: 1.0 };
    visibility::keep_enclosed(&mut enclosed, unit, &frame, double_sided, inputs.cancellation);
    enclosed
}

/// Part of a mesh's faces that pass through others.
fn self_intersecting_fraction(mesh: &TriMesh) -> f64 {
    self_intersecting_faces(mesh) as f64 / mesh.triangles.len().max(1) as f64
}
