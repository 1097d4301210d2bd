//! Simplifies one candidate to each of the budgets.

use glam::{Affine3A, Vec3};

use super::input::{SimplifyInput, pixels_in_motion};
use super::inputs::Inputs;
use super::params::SimplifyParams;
use super::qem::Simplifier;
use super::self_intersection::{self, TOLERATED, WORTH_DEEP_RESOLUTION};
use super::shape::{Shape, Shortfall};
use super::unit_sphere::{from_unit_sphere, to_unit_sphere};
use super::visibility::{self, face_weights};
use crate::animation::{Motions, Poses};
use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;

/// Faces kept, as a multiple of the largest budget, when enclosed faces are looked for.
const ENCLOSED_AT: usize = 4;
/// A component that deserves fewer faces than this is dropped.
const NEGLIGIBLE_FACES: f64 = 0.75;
/// Largest fraction of a budget that is kept for the faces along joint planes.
const MOST_RESERVED: f64 = 0.08;
/// Depth of the contacts that are resolved, as a fraction of the mean edge.
const SHALLOW: f64 = 0.1;
/// The depth where the shallow one is not enough.
const DEEP: f64 = 0.5;

/// Collapses a candidate to each budget. Some candidates offer several shapes for each: the second shapes of all budgets
/// then follow the first shapes of all.
pub(super) fn simplify_to_budgets(
    inputs: &Inputs<'_>,
    params: &SimplifyParams,
    candidate: Candidate,
    input: &SimplifyInput,
) -> Vec<Shape> {
    let Some(simplifier) = prepare(inputs, params, input) else { return Vec::new() };
    let collapse = Collapse { inputs, params, candidate, double_sided: input.double_sided };
    let run = |depth| collapse.run(simplifier.clone(), depth);
    let self_intersects = self_intersection::fraction(&simplifier.mesh()) > TOLERATED;
    let (resolved, free) = rayon::join(|| run(Some(SHALLOW)), || self_intersects.then(|| run(None)));
    let Collapsed { mut shapes, is_stuck } = resolved;
    let mut fractions = shapes.iter().map(|shape| self_intersection::fraction(&shape.mesh));
    if fractions.any(|fraction| fraction > TOLERATED && fraction < WORTH_DEEP_RESOLUTION) {
        shapes.extend(run(Some(DEEP)).shapes);
    }
    // Intersecting components, and the two sides of a thin sheet, may fare better where each collapses freely.
    let free = free.or_else(|| is_stuck.then(|| run(None)));
    shapes.extend(free.into_iter().flat_map(|collapsed| collapsed.shapes));
    shapes
}

/// Drops the faces that nothing sees from a mesh a few times as large as the largest budget; `None` if cancelled.
fn prepare(inputs: &Inputs<'_>, params: &SimplifyParams, input: &SimplifyInput) -> Option<Simplifier> {
    let is_cancelled = || inputs.cancellation.is_cancelled();
    let unit = to_unit_sphere(&input.mesh, &inputs.sphere);
    let mut weights = face_weights(&unit, &input.pixels, params.collapse.visible_weight);
    if let Some(importance) = inputs.importance {
        let factors = importance.of_faces(&input.mesh, inputs.bvh);
        weights.iter_mut().zip(factors).for_each(|(weight, factor)| *weight *= factor);
    }
    if is_cancelled() {
        return None;
    }
    let mut simplifier = Simplifier::new(&unit, &weights, params.collapse.curvature);
    simplifier.stop_with(inputs.cancellation);
    let largest = params.budgets.last().copied().unwrap_or(0) as usize;
    if params.collapse.remove_invisible {
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

/// The collapse of one candidate.
struct Collapse<'a> {
    inputs: &'a Inputs<'a>,
    params: &'a SimplifyParams,
    candidate: Candidate,
    double_sided: bool,
}

/// Shapes that one mesh was collapsed to.
struct Collapsed {
    /// One per budget, in their order.
    shapes: Vec<Shape>,
    /// A budget could only be met by more self-intersecting faces.
    is_stuck: bool,
}

impl Collapse<'_> {
    /// Collapses to each budget, the largest first. Contacts are resolved on the way up to `depth`, a fraction of the mean
    /// edge; with `None` the mesh may intersect itself.
    fn run(&self, mut simplifier: Simplifier, depth: Option<f64>) -> Collapsed {
        let Self { inputs, params, candidate, double_sided } = *self;
        let resolve = |simplifier: &mut Simplifier| {
            depth.into_iter().for_each(|depth| simplifier.resolve_intersections(depth));
        };
        resolve(&mut simplifier);
        let mut shapes = Vec::new();
        for &budget in params.budgets.iter().rev().take_while(|_| !inputs.cancellation.is_cancelled()) {
            if params.collapse.remove_invisible {
                simplifier.drop_negligible_components(budget as usize, NEGLIGIBLE_FACES);
            }
            let shortfall = match simplifier.faces() <= budget as usize {
                _ if inputs.tools.has_joint_planes() => Shortfall::JointPlanes,
                true => Shortfall::VisibleFaces,
                false => Shortfall::Components,
            };
            simplifier.run(budget as usize);
            resolve(&mut simplifier);
            let mesh = self.with_joint_planes(&simplifier, budget as usize);
            shapes.push(Shape::unscored(mesh, double_sided, candidate, shortfall));
        }
        shapes.reverse();
        Collapsed { shapes, is_stuck: simplifier.is_stuck() }
    }

    /// The mesh of the simplifier, split along the joint planes within the budget. To make room, a copy of the simplifier
    /// collapses further by as many faces as the split adds.
    fn with_joint_planes(&self, simplifier: &Simplifier, budget: usize) -> TriMesh {
        let Self { inputs, params, .. } = *self;
        let mesh = from_unit_sphere(simplifier.mesh(), &inputs.sphere);
        if !inputs.tools.has_joint_planes() {
            return mesh;
        }
        let most = mesh.triangles.len() + (MOST_RESERVED * budget as f64) as usize;
        let reserved = inputs.tools.split_at_joints(&mesh, most).triangles.len() - mesh.triangles.len();
        let mut lower = simplifier.clone();
        lower.run(budget - reserved);
        let mesh = from_unit_sphere(lower.mesh(), &inputs.sphere);
        if params.collapse.split_at_joints { inputs.tools.split_at_joints(&mesh, budget) } else { mesh }
    }
}

/// Motions of points in the unit sphere, there.
fn motions_in_unit_sphere(inputs: &Inputs<'_>, poses: &Poses<'_>, unit: &[Vec3]) -> Motions {
    let BoundingSphere { centre, radius } = inputs.sphere;
    let positions: Vec<Vec3> = unit.iter().map(|p| *p * radius + centre).collect();
    let from_unit = Affine3A::from_translation(centre) * Affine3A::from_scale(Vec3::splat(radius));
    poses.motions_by_closest_point(inputs.bvh, &positions).rebased(from_unit)
}

/// Faces of a mesh in the unit sphere that nothing sees: no camera sees them in motion, and no ray from them escapes at
/// rest.
fn enclosed(inputs: &Inputs<'_>, unit: &TriMesh, double_sided: bool) -> Vec<bool> {
    let mesh = from_unit_sphere(unit.clone(), &inputs.sphere);
    let mut enclosed: Vec<bool> =
        pixels_in_motion(inputs, &mesh, &|_| double_sided).into_iter().map(|pixels| pixels == 0).collect();
    let sphere = BoundingSphere { centre: Vec3::ZERO, radius: 1.0 };
    visibility::keep_enclosed(&mut enclosed, unit, &sphere, double_sided, inputs.cancellation);
    enclosed
}
