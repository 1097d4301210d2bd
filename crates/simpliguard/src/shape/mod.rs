//! Low-poly meshes of exact budgets.
//!
//! Several roads lead there: reconstructions at different resolutions, and the source's own triangles, welded and cut
//! into a manifold. On each, faces that no view reaches go first, then edges collapse by quadric error weighted by how
//! large each face appears. Every road's result at every budget is scored by rendering it against the source, and the
//! best is kept: a model that suits plain edge collapse is not made worse by reconstruction. The quick roads come first, and
//! decide whether the others are worth their time.
//!
//! The result is a manifold, with boundary only where nothing sees it or where the source has one.

mod candidates;
mod collapse;
mod contest;
mod deviation;
mod foliage;
mod importance;
mod layers;
mod params;
mod quadric;
mod solid;
mod visibility;
mod weld;

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use crate::mesh::{TriMesh, self_intersecting};
use crate::model::{Influences, Model};
use crate::objects::{form_key, road_key};
use crate::reconstruct;
use crate::render::{Frame, Motions, View};
use crate::rig::{self, Donor, Poses, Transfer};
use crate::{Bvh, Cancellation, Context, Error, StageId};
use collapse::Simplifier;
use contest::{Contest, is_tangled};

pub use deviation::{Deviation, Gauge};
pub use foliage::{Cards, NO_CARD};
pub use importance::Importance;
pub use params::{JointPlanes, Params};
pub use solid::Solid;
pub use visibility::texel_density;

/// Directions that a mesh in the rest pose is looked at from.
const DIRECTIONS: usize = 48;
/// Faces kept, as a multiple of the largest budget, when enclosed faces are looked for.
const ENCLOSED_AT: usize = 4;
/// Rings of unseen faces kept around seen ones.
const RINGS: usize = 2;
/// A component that deserves fewer faces than this is dropped.
const NEGLIGIBLE_FACES: f64 = 0.75;

/// Largest part of a budget that is kept for the faces along joint planes.
const MOST_RESERVED: f64 = 0.08;

/// How far vertices in one place are moved apart, as a part of the frame's radius.
const PARTED: f32 = 2e-5;

/// Where a shape came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Road {
    /// A reconstruction at this resolution.
    Reconstruction(reconstruct::Params),
    /// The source's own triangles.
    Source,
    /// Cut-out cards for the leaves, the rest collapsed.
    Cards,
}

impl std::fmt::Display for Road {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Reconstruction(p) => write!(f, "reconstruction {} (offset {})", p.resolution, p.offset),
            Self::Source => f.write_str("source"),
            Self::Cards => f.write_str("cards"),
        }
    }
}

/// A mesh within a budget.
#[derive(Clone, Debug)]
pub struct Shape {
    /// World space.
    pub mesh: TriMesh,
    /// Back faces are seen too.
    pub double_sided: bool,
    /// Where it came from.
    pub road: Road,
    /// Error against the source's pictures that no texture removes, mean square per pixel.
    pub render_error: f64,
    /// Distances to the source, in the rest pose.
    pub deviation: Deviation,
    /// Faces that pass through others.
    pub self_intersecting: usize,
    /// Which faces are cut-out cards, if the source is foliage.
    pub cards: Option<Cards>,
}

impl Shape {
    fn unjudged(mesh: TriMesh, double_sided: bool, road: Road, cards: Option<Cards>) -> Self {
        let (render_error, deviation) = (f64::INFINITY, Deviation::default());
        Self { mesh, double_sided, road, render_error, deviation, self_intersecting: 0, cards }
    }
}

/// What shapes are made from and judged by.
pub struct Inputs<'a> {
    /// The source.
    pub model: &'a Model,
    /// Over its triangles.
    pub bvh: &'a Bvh,
    /// Where influences come from.
    pub donor: &'a Donor<'a>,
    /// Its triangles that can be seen at all.
    pub solid: &'a Solid,
    /// Measures distances to them.
    pub gauge: &'a Gauge<'a>,
    /// Around the source.
    pub frame: Frame,
    /// The source's pictures, in the rest pose and in `poses`.
    pub views: &'a [View],
    /// Poses that its clips put it in.
    pub poses: Option<&'a Poses<'a>>,
    /// How much its triangles count, unless they all count alike.
    pub importance: Option<&'a Importance>,
    /// Looked at within the steps.
    pub cancellation: &'a Cancellation,
}

impl Inputs<'_> {
    /// How a mesh in the rest pose hangs on the source's bones.
    fn influences(&self, mesh: &TriMesh) -> Vec<Influences> {
        rig::transfer(self.donor, mesh, &mesh.vertex_normals(), Transfer::default()).0
    }

    /// How a mesh in the rest pose moves with them.
    fn motions(&self, mesh: &TriMesh) -> Motions {
        self.poses.map_or_else(Motions::default, |poses| poses.all_motions(&self.influences(mesh)))
    }
}

/// Finds the best shape for each budget, in their order.
///
/// # Errors
/// If cancelled, or if no road meets a budget.
pub fn shape(inputs: &Inputs<'_>, params: &Params, context: &Context<'_>) -> Result<Vec<Shape>, Error> {
    let mut shapes = best_shapes(inputs, params, context)?;
    for shape in &mut shapes {
        weld::part_coincident(&mut shape.mesh, PARTED * inputs.frame.radius);
    }
    Ok(shapes)
}

/// Whether a store knows what the first of the roads leads to, so that shapes are there soon.
pub fn is_known(inputs: &Inputs<'_>, params: &Params, context: &Context<'_>) -> bool {
    let first = first_roads(params).next();
    let key = first.and_then(|road| context.key(|| road_key(&form_key(inputs), params, road)));
    key.is_some_and(|key| context.knows(&key))
}

/// Collapses a manifold mesh, with or without boundary, to at most `faces` faces by plain quadric error: the step that the
/// roads share, without a source to compare with.
pub fn collapse(mesh: &TriMesh, faces: usize) -> TriMesh {
    let frame = Frame::around(&mesh.positions);
    let unit = to_unit_sphere(mesh, &frame);
    let areas: Vec<f64> = (0..unit.triangles.len()).map(|t| 0.5 * f64::from(unit.area_vector(t).length())).collect();
    let mut simplifier = Simplifier::new(&unit, &areas, 0.0);
    simplifier.run(faces);
    from_unit_sphere(simplifier.mesh(), &frame)
}

fn best_shapes(inputs: &Inputs<'_>, params: &Params, context: &Context<'_>) -> Result<Vec<Shape>, Error> {
    if params.cards
        && let Some(shapes) = foliage::shapes(inputs, params)
    {
        context.check(&inputs.model.name)?;
        return Ok(shapes);
    }
    let judges = Judges::new(inputs);
    let mut contests: Vec<Contest> = params.budgets.iter().map(|_| Contest::default()).collect();
    let walk_on =
        |roads: &[Road], contests: &mut [Contest]| walk_all(inputs, params, roads, &judges, contests, context);
    walk_on(&first_roads(params).collect::<Vec<_>>(), &mut contests)?;
    let fine = params.fine.filter(|_| !contest::source_serves(&contests));
    let thick = params.thick.filter(|_| contests.last().is_some_and(Contest::wants_thick));
    let further: Vec<Road> = fine.into_iter().chain(thick).map(Road::Reconstruction).collect();
    walk_on(&further, &mut contests)?;
    if contests.iter().any(Contest::is_empty) {
        // A coarse, thick reconstruction has few handles to get stuck on.
        for road in [96, 64, 32].map(|n| Road::Reconstruction(reconstruct::Params::thick(n))) {
            let mut spare: Vec<Contest> = params.budgets.iter().map(|_| Contest::default()).collect();
            walk_on(&[road], &mut spare)?;
            for (contest, spare) in contests.iter_mut().zip(spare) {
                if contest.is_empty() {
                    *contest = spare;
                }
            }
        }
    }
    if let Some(finer) = params.finer
        && contests.iter().any(Contest::wants_finer)
    {
        walk_on(&[Road::Reconstruction(finer)], &mut contests)?;
    }
    let found: Option<Vec<Shape>> = contests.into_iter().map(Contest::into_best).collect();
    found.ok_or_else(|| {
        Error::invalid(
            &inputs.model.name,
            StageId::Shape,
            format!("no mesh of at most {} faces was found", params.budgets.first().copied().unwrap_or(0)),
            "raise the smallest budget in `faces`",
        )
    })
}

/// The quick roads, which are always walked.
fn first_roads(params: &Params) -> impl Iterator<Item = Road> {
    params.reconstruction.map(Road::Reconstruction).into_iter().chain(params.source.then_some(Road::Source))
}

/// Faces of a mesh that pass through others.
fn tangled_faces(mesh: &TriMesh) -> usize {
    self_intersecting(mesh).into_iter().filter(|face| *face).count()
}

/// What shapes are judged by.
struct Judges<'a> {
    views: Vec<&'a View>,
    /// A factor for each of their pixels; empty if all count alike.
    weights: Vec<Vec<f32>>,
}

impl<'a> Judges<'a> {
    fn new(inputs: &Inputs<'a>) -> Self {
        let views: Vec<&View> = inputs.views.iter().step_by(3).collect();
        let weights = inputs.importance.map(|i| i.of_pixels(inputs.model, inputs.poses, &views)).unwrap_or_default();
        Self { views, weights }
    }

    fn judge(&self, inputs: &Inputs<'_>, shape: &mut Shape) {
        let (mesh, double_sided) = (&shape.mesh, shape.double_sided);
        let motions = inputs.motions(mesh);
        let render_error = candidates::render_error(mesh, &motions, double_sided, &self.views, &self.weights);
        let (deviation, self_intersecting) = (inputs.gauge.measure(mesh), tangled_faces(mesh));
        (shape.render_error, shape.deviation, shape.self_intersecting) = (render_error, deviation, self_intersecting);
    }
}

/// Walks the roads and enters what they lead to into the contests.
fn walk_all(
    inputs: &Inputs<'_>,
    params: &Params,
    roads: &[Road],
    judges: &Judges<'_>,
    contests: &mut [Contest],
    context: &Context<'_>,
) -> Result<(), Error> {
    let form = context.key(|| form_key(inputs));
    let walk = |&road| {
        let key = form.map(|form| road_key(&form, params, road));
        context.stored(key, || Ok(walk(inputs, params, road)))
    };
    let walked: Result<Vec<Vec<Shape>>, Error> = roads.par_iter().map(walk).collect();
    context.check(&inputs.model.name)?;
    for shapes in walked? {
        for (i, mut shape) in shapes.into_iter().enumerate() {
            let (contest, budget) = (i % contests.len(), params.budgets[i % contests.len()]);
            let faces = shape.mesh.triangles.len();
            if faces == 0 || faces > budget as usize {
                continue;
            }
            context.check(&inputs.model.name)?;
            judges.judge(inputs, &mut shape);
            let Shape { road, render_error: error, deviation, self_intersecting: tangled, .. } = &shape;
            tracing::debug!(%road, budget, faces, error, distance = deviation.mean, tangled, "candidate");
            contests[contest].enter(shape);
        }
    }
    Ok(())
}

/// Shapes for each budget along a road, in their order, once or more. Reads no texture.
fn walk(inputs: &Inputs<'_>, params: &Params, road: Road) -> Vec<Shape> {
    let Dense { mesh, pixels, double_sided } = dense(inputs, params, road);
    collapse_dense(inputs, params, road, &mesh, &pixels, double_sided)
}

/// Collapses a mesh to each budget; some roads offer several shapes, the second for each behind the first for all.
fn collapse_dense(
    inputs: &Inputs<'_>,
    params: &Params,
    road: Road,
    mesh: &TriMesh,
    pixels: &[u32],
    double_sided: bool,
) -> Vec<Shape> {
    if inputs.cancellation.is_cancelled() {
        return Vec::new();
    }
    let unit = to_unit_sphere(mesh, &inputs.frame);
    let mut weights = face_weights(&unit, pixels, params.visible_weight);
    if let Some(importance) = inputs.importance {
        weights.iter_mut().zip(importance.of_faces(mesh, inputs.bvh)).for_each(|(weight, factor)| *weight *= factor);
    }
    if inputs.cancellation.is_cancelled() {
        return Vec::new();
    }
    let mut simplifier = Simplifier::new(&unit, &weights, params.curvature);
    simplifier.stop_with(inputs.cancellation);
    let largest = params.budgets.last().copied().unwrap_or(0) as usize;
    if params.remove_invisible {
        simplifier.drop_negligible_components(largest, NEGLIGIBLE_FACES);
        simplifier.run(ENCLOSED_AT * largest);
        if inputs.cancellation.is_cancelled() {
            return Vec::new();
        }
        simplifier.remove_faces(&enclosed(inputs, &simplifier.mesh(), double_sided));
    } else if inputs.poses.is_some() {
        simplifier.run(ENCLOSED_AT * largest);
    }
    if let Some(poses) = inputs.poses {
        simplifier.follow(poses.count(), |unit| motions_in_unit_sphere(inputs, poses, unit));
    }
    let down = |simplifier: &mut Simplifier| down_to_budgets(simplifier, inputs, params, road, double_sided);
    if inputs.cancellation.is_cancelled() {
        return Vec::new();
    }
    let dense = simplifier.mesh();
    let tangled = is_tangled(dense.triangles.len(), tangled_faces(&dense));
    let mut unwatched = simplifier.clone();
    simplifier.watch_intersections();
    let mut shapes = down(&mut simplifier);
    if tangled || simplifier.is_stuck() {
        // Parts that pass through each other, and two sides of a thin sheet, may fare better where each goes its own way.
        shapes.extend(down(&mut unwatched));
    }
    shapes
}

/// One shape per budget, in their order.
fn down_to_budgets(
    simplifier: &mut Simplifier,
    inputs: &Inputs<'_>,
    params: &Params,
    road: Road,
    double_sided: bool,
) -> Vec<Shape> {
    let mut shapes = Vec::new();
    for &budget in params.budgets.iter().rev().take_while(|_| !inputs.cancellation.is_cancelled()) {
        if params.remove_invisible {
            simplifier.drop_negligible_components(budget as usize, NEGLIGIBLE_FACES);
        }
        simplifier.run(budget as usize);
        let mesh = with_joint_planes(simplifier, inputs, &params.joint_planes, budget as usize);
        shapes.push(Shape::unjudged(mesh, double_sided, road, None));
    }
    shapes.reverse();
    shapes
}

/// What the simplifier has come down to, split along the joint planes within the budget: it goes further down by as many
/// faces as they add.
fn with_joint_planes(simplifier: &Simplifier, inputs: &Inputs<'_>, wanted: &JointPlanes, budget: usize) -> TriMesh {
    let mesh = from_unit_sphere(simplifier.mesh(), &inputs.frame);
    if wanted.planes.is_empty() {
        return mesh;
    }
    let split = |mesh: &TriMesh, most: usize| {
        rig::split_along(inputs.model, mesh, &inputs.influences(mesh), &wanted.planes, most).mesh
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
    let Frame { centre, radius } = inputs.frame;
    let positions: Vec<Vec3> = unit.iter().map(|p| *p * radius + centre).collect();
    let from_unit = Affine3A::from_translation(centre) * Affine3A::from_scale(Vec3::splat(radius));
    poses.motions_by_closest_point(inputs.bvh, &positions).rebased(from_unit)
}

/// Which faces of a mesh in the unit sphere nothing sees: no camera in motion, and no ray from them at rest gets out.
fn enclosed(inputs: &Inputs<'_>, unit: &TriMesh, double_sided: bool) -> Vec<bool> {
    let mesh = from_unit_sphere(unit.clone(), &inputs.frame);
    let mut enclosed: Vec<bool> =
        pixels_in_motion(inputs, &mesh, &|_| double_sided).into_iter().map(|pixels| pixels == 0).collect();
    let frame = Frame { centre: Vec3::ZERO, radius: 1.0 };
    visibility::keep_enclosed(&mut enclosed, unit, &frame, double_sided, inputs.cancellation);
    enclosed
}

/// A mesh before its collapse, and how many pixels see each face.
struct Dense {
    mesh: TriMesh,
    pixels: Vec<u32>,
    double_sided: bool,
}

fn dense(inputs: &Inputs<'_>, params: &Params, road: Road) -> Dense {
    let solid = inputs.solid;
    let (mesh, two_sided): (TriMesh, Vec<bool>) = match road {
        Road::Reconstruction(p) => {
            let mesh = layers::wrap(inputs, &p);
            let faces = mesh.triangles.len();
            (mesh, vec![false; faces])
        }
        // Cards begin with the source's own triangles.
        Road::Source | Road::Cards => {
            let (mesh, welded_from) = weld::weld(&solid.mesh.positions, &solid.mesh.triangles);
            let two_sided =
                welded_from.iter().map(|&t| inputs.model.material_of(solid.source[t as usize]).double_sided);
            (mesh, two_sided.collect())
        }
    };
    let pixels = visible_pixels(inputs, &mesh, &|t| two_sided[t]);
    let sided = pixels.iter().zip(&two_sided).filter(|(_, two)| **two).map(|(&n, _)| u64::from(n)).sum::<u64>();
    let double_sided = 2 * sided > pixels.iter().map(|&n| u64::from(n)).sum::<u64>();
    if !params.remove_invisible || pixels.iter().all(|&n| n == 0) || inputs.cancellation.is_cancelled() {
        return Dense { mesh, pixels, double_sided };
    }
    let mut seen: Vec<bool> = pixels.iter().map(|&n| n > 0).collect();
    visibility::grow(&mesh, &mut seen, RINGS);
    let kept = weld::cut(&mesh.filtered(|t| seen[t]));
    let pixels = pixels.iter().zip(&seen).filter(|(_, seen)| **seen).map(|(&n, _)| n).collect();
    Dense { mesh: kept, pixels, double_sided }
}

/// Pixels that see each face, at rest and, half as many, in motion.
fn visible_pixels(inputs: &Inputs<'_>, mesh: &TriMesh, double_sided: &(impl Fn(usize) -> bool + Sync)) -> Vec<u32> {
    let mut pixels = visibility::visible_pixels(mesh, &inputs.frame, DIRECTIONS, double_sided, inputs.cancellation);
    let moving = pixels_in_motion(inputs, mesh, double_sided);
    pixels.iter_mut().zip(moving).for_each(|(sum, n)| *sum += n);
    pixels
}

/// Pixels that see each face in the poses, from half as many directions as at rest over all of them.
fn pixels_in_motion(inputs: &Inputs<'_>, mesh: &TriMesh, double_sided: &(impl Fn(usize) -> bool + Sync)) -> Vec<u32> {
    let mut pixels = vec![0; mesh.triangles.len()];
    let Some(poses) = inputs.poses else { return pixels };
    let directions = (DIRECTIONS / 2).div_ceil(poses.count());
    for posed in poses.posed(mesh, &poses.motions_by_closest_point(inputs.bvh, &mesh.positions)) {
        let frame = Frame::around(&posed.positions);
        let seen = visibility::visible_pixels(&posed, &frame, directions, double_sided, inputs.cancellation);
        pixels.iter_mut().zip(seen).for_each(|(sum, n)| *sum += n);
    }
    pixels
}

fn to_unit_sphere(mesh: &TriMesh, frame: &Frame) -> TriMesh {
    let positions = mesh.positions.iter().map(|p| (*p - frame.centre) / frame.radius).collect();
    TriMesh { positions, triangles: mesh.triangles.clone() }
}

fn from_unit_sphere(mesh: TriMesh, frame: &Frame) -> TriMesh {
    let positions = mesh.positions.iter().map(|p| *p * frame.radius + frame.centre).collect();
    TriMesh { positions, triangles: mesh.triangles }
}

/// Area of each face, scaled by how many pixels see its surroundings per area, in the mean one.
fn face_weights(mesh: &TriMesh, pixels: &[u32], visible: f64) -> Vec<f64> {
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
