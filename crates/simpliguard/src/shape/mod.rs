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
mod dense;
mod descent;
mod deviation;
mod foliage;
mod importance;
mod layers;
mod params;
mod quadric;
mod solid;
mod visibility;
mod weld;

use rayon::prelude::*;

use crate::mesh::{TriMesh, self_intersecting};
use crate::model::{Influences, Model};
use crate::objects::{form_key, road_key};
use crate::reconstruct;
use crate::render::{Frame, Motions, View};
use crate::rig::{self, Donor, Poses, Transfer};
use crate::{Bvh, Cancellation, Context, Error, StageId};
use collapse::Simplifier;
use contest::Contest;
use dense::dense;
use descent::{descend, from_unit_sphere, to_unit_sphere};

pub use deviation::{Deviation, Gauge};
pub use foliage::{Cards, NO_CARD};
pub use importance::Importance;
pub use params::{JointPlanes, Params};
pub use solid::Solid;
pub use visibility::texel_density;

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
    let in_budget = |(contest, shape): &(usize, Shape)| {
        (1..=params.budgets[*contest] as usize).contains(&shape.mesh.triangles.len())
    };
    let by_contest = |shapes: Vec<Shape>| shapes.into_iter().enumerate().map(|(i, shape)| (i % contests.len(), shape));
    let mut offered: Vec<(usize, Shape)> = walked?.into_iter().flat_map(by_contest).filter(in_budget).collect();
    offered.par_iter_mut().try_for_each(|(_, shape)| {
        judges.judge(inputs, shape);
        context.check(&inputs.model.name)
    })?;
    for (contest, shape) in offered {
        let Shape { road, render_error: error, deviation, self_intersecting: tangled, .. } = &shape;
        let (budget, faces) = (params.budgets[contest], shape.mesh.triangles.len());
        tracing::debug!(%road, budget, faces, error, distance = deviation.mean, tangled, "candidate");
        contests[contest].enter(shape);
    }
    Ok(())
}

/// Shapes for each budget along a road, in their order, once or more. Reads no texture.
fn walk(inputs: &Inputs<'_>, params: &Params, road: Road) -> Vec<Shape> {
    descend(inputs, params, road, &dense(inputs, params, road))
}
