//! Collapses one candidate to each of the budgets.

use glam::{Affine3A, Vec3};

use super::enclosed::{enclosed_by_random_rays, keep_enclosed};
use super::face_weights::{face_areas, face_weights};
use super::inputs::Inputs;
use super::params::SimplifyParams;
use super::qem::Simplifier;
use super::shape::{Shape, Shortfall};
use super::simplify_input::{SimplifyInput, pixels_in_all_poses};
use super::unit_sphere::{from_unit_sphere, to_unit_sphere};

use crate::animation::{Motions, Poses};
use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;
use crate::geometry::self_intersection::{self, DEEP_CONTACT, SHALLOW_CONTACT, TOLERATED, WORTH_DEEP_RESOLUTION};

/// Number of faces at which enclosed faces are removed, as a multiple of the largest budget.
const ENCLOSED_AT: usize = 4;
/// A component is removed if its share of the budget is fewer faces than this.
const NEGLIGIBLE_FACES: f64 = 0.75;
/// Largest fraction of a budget that is reserved for splitting faces along joint planes.
const MOST_RESERVED: f64 = 0.08;

/// Collapses a candidate to each budget. Some candidates offer alternatives: a second shape for each budget then
/// follows the first shapes of all budgets, and so on. Empty if cancelled.
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
    let (resolved, free) = rayon::join(|| run(Some(SHALLOW_CONTACT)), || self_intersects.then(|| run(None)));
    let Collapsed { mut shapes, unblocked, is_stuck } = resolved;
    let mut fractions = shapes.iter().map(|shape| self_intersection::fraction(&shape.mesh));
    if fractions.any(|fraction| fraction > TOLERATED && fraction < WORTH_DEEP_RESOLUTION) {
        shapes.extend(run(Some(DEEP_CONTACT)).shapes);
    }
    // Components that intersect each other, and the two sides of a thin sheet, may score better if each collapses
    // freely.
    let free = free.or_else(|| is_stuck.then(|| run(None)));
    shapes.extend(free.into_iter().flat_map(|collapsed| collapsed.shapes));
    shapes.extend(unblocked);
    shapes
}

/// Collapses the mesh to a few times the largest budget, and removes the faces that nothing sees. `None` if cancelled.
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
    let mut simplifier = match params.collapse.curvature_angle {
        Some(angle) => Simplifier::with_curvature(&unit, &weights, params.collapse.curvature, angle),
        None => Simplifier::new(&unit, &weights, 0.0),
    };
    simplifier.stop_with(inputs.cancellation);
    let largest = params.budgets.last().copied().unwrap_or(0) as usize;
    if params.collapse.remove_invisible && !input.is_clear {
        simplifier.remove_negligible_components(largest, NEGLIGIBLE_FACES);
        simplifier.run(ENCLOSED_AT * largest);
        if is_cancelled() {
            return None;
        }
        simplifier.remove_faces(&enclosed(inputs, &simplifier.mesh(), input.double_sided));
    } else if inputs.poses.is_some() {
        simplifier.run(ENCLOSED_AT * largest);
    }
    simplifier.compact();
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

/// The shapes to which one mesh was collapsed.
struct Collapsed {
    /// One for each budget, in the order of the budgets.
    shapes: Vec<Shape>,
    /// The same without components that block the collapse to a budget; empty shapes for budgets that none blocks. Empty if
    /// none blocks any.
    unblocked: Vec<Shape>,
    /// True if a budget was met only by collapses that add self-intersections.
    is_stuck: bool,
}

impl Collapse<'_> {
    /// Collapses to each budget, the largest first. Before the first and after each collapse, contacts up to `depth`, a
    /// fraction of the mean edge length, are resolved. With `None` the mesh may intersect itself.
    fn run(&self, mut simplifier: Simplifier, depth: Option<f64>) -> Collapsed {
        let Self { inputs, params, candidate, double_sided } = *self;
        let resolve = |simplifier: &mut Simplifier| {
            depth.into_iter().for_each(|depth| simplifier.resolve_intersections(depth));
        };
        resolve(&mut simplifier);
        let whole = simplifier.clone();
        let (mut shapes, mut unblocked) = (Vec::new(), Vec::new());
        for &budget in params.budgets.iter().rev().take_while(|_| !inputs.cancellation.is_cancelled()) {
            if params.collapse.remove_invisible {
                simplifier.remove_negligible_components(budget as usize, NEGLIGIBLE_FACES);
            }
            let shortfall = match simplifier.faces() <= budget as usize {
                _ if inputs.tools.has_joint_planes() => Shortfall::JointPlanes,
                true => Shortfall::VisibleFaces,
                false => Shortfall::Components,
            };
            let collapse = |simplifier: &mut Simplifier, shortfall| {
                simplifier.run(budget as usize);
                resolve(simplifier);
                let mesh = self.without_unseen(self.with_joint_planes(simplifier, budget as usize));
                Shape::unscored(mesh, double_sided, candidate, shortfall)
            };
            shapes.push(collapse(&mut simplifier, shortfall));
            let freed = simplifier.is_exhausted().then(|| whole.without_blocking_components(budget as usize)).flatten();
            unblocked.push(freed.map_or_else(Shape::empty, |mut freed| collapse(&mut freed, Shortfall::Components)));
        }
        shapes.reverse();
        unblocked.reverse();
        if unblocked.iter().all(|shape| shape.mesh.triangles.is_empty()) {
            unblocked.clear();
        }
        Collapsed { shapes, unblocked, is_stuck: simplifier.is_stuck() }
    }

    /// The mesh without the faces that no random ray leaves from (section 3.2 of the paper), if there are any rays.
    fn without_unseen(&self, mesh: TriMesh) -> TriMesh {
        let Self { inputs, params, .. } = *self;
        let rays = params.collapse.invisible_rays;
        if rays == 0 {
            return mesh;
        }
        let unit = to_unit_sphere(&mesh, &inputs.sphere);
        let mut simplifier = Simplifier::new(&unit, &face_areas(&unit), 0.0);
        simplifier.remove_faces(&enclosed_by_random_rays(&unit, rays, inputs.cancellation));
        from_unit_sphere(simplifier.mesh(), &inputs.sphere)
    }

    /// The mesh of the simplifier, split along the joint planes within the budget. To make room, a copy of the
    /// simplifier first collapses further, by as many faces as the split adds.
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

/// Motions of points in the unit sphere, in the coordinates of the unit sphere.
fn motions_in_unit_sphere(inputs: &Inputs<'_>, poses: &Poses<'_>, unit: &[Vec3]) -> Motions {
    let BoundingSphere { centre, radius } = inputs.sphere;
    let positions: Vec<Vec3> = unit.iter().map(|p| *p * radius + centre).collect();
    let from_unit = Affine3A::from_translation(centre) * Affine3A::from_scale(Vec3::splat(radius));
    poses.motions_by_closest_point(inputs.bvh, &positions).rebased(from_unit)
}

/// Faces of a mesh in the unit sphere that nothing sees: no camera sees them at rest or in motion, and no ray from them
/// escapes in the rest pose.
fn enclosed(inputs: &Inputs<'_>, unit: &TriMesh, double_sided: bool) -> Vec<bool> {
    let mesh = from_unit_sphere(unit.clone(), &inputs.sphere);
    let mut enclosed: Vec<bool> =
        pixels_in_all_poses(inputs, &mesh, &|_| double_sided).covered.into_iter().map(|pixels| pixels == 0).collect();
    let sphere = BoundingSphere { centre: Vec3::ZERO, radius: 1.0 };
    keep_enclosed(&mut enclosed, unit, &sphere, double_sided, inputs.cancellation);
    enclosed
}
