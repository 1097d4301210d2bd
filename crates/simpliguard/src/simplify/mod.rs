//! Low-poly meshes of exact budgets.
//!
//! Several candidates lead there: reconstructions at different resolutions, and the source's own triangles, welded and cut
//! into a manifold. On each, faces that no view reaches go first, then edges collapse by quadric error weighted by how
//! large each face appears. Every candidate's result at every budget is scored by rendering it against the source, and the
//! best is kept: a model that suits plain edge collapse is not made worse by reconstruction. The quick candidates come first, and
//! decide whether the others are worth their time.
//!
//! The result is a manifold, with boundary only where nothing sees it or where the source has one.

mod budgets;
mod candidates;
mod deviation;
mod importance;
mod input;
mod inputs;
mod opaque;
mod params;
mod qem;
mod score;
mod select;
mod shape;
mod visibility;
mod weld;

use rayon::prelude::*;

use crate::data::{Candidate, Reconstruction, TriMesh};
use crate::geometry::{BoundingSphere, self_intersecting};
use crate::pipeline::store::{candidate_key, form_key};
use crate::render::View;
use crate::{Context, Error, StageId};
use budgets::{from_unit_sphere, simplify_to_budgets, to_unit_sphere};
use candidates::cards;
use input::input;
use qem::Simplifier;
use select::Selection;

pub use deviation::DeviationMetric;
pub use importance::Importance;
pub use inputs::Inputs;
pub use opaque::OpaqueSurface;
pub use params::{JointPlanes, Params};
pub use shape::Shape;
pub use visibility::texel_density;

/// How far vertices in one place are moved apart, as a part of the frame's radius.
const PARTED: f32 = 2e-5;

/// Finds the best shape for each budget, in their order.
///
/// # Errors
/// If cancelled, or if no candidate meets a budget.
pub fn shape(inputs: &Inputs<'_>, params: &Params, context: &Context<'_>) -> Result<Vec<Shape>, Error> {
    let mut shapes = best_shapes(inputs, params, context)?;
    for shape in &mut shapes {
        weld::part_coincident(&mut shape.mesh, PARTED * inputs.frame.radius);
    }
    Ok(shapes)
}

/// Whether a store knows what the first of the candidates leads to, so that shapes are there soon.
pub fn is_known(inputs: &Inputs<'_>, params: &Params, context: &Context<'_>) -> bool {
    let first = first_candidates(params).next();
    let key = first.and_then(|candidate| context.key(|| candidate_key(&form_key(inputs), params, candidate)));
    key.is_some_and(|key| context.knows(&key))
}

/// Collapses a manifold mesh, with or without boundary, to at most `faces` faces by plain quadric error: the step that the
/// candidates share, without a source to compare with.
pub fn collapse(mesh: &TriMesh, faces: usize) -> TriMesh {
    let frame = BoundingSphere::around(&mesh.positions);
    let unit = to_unit_sphere(mesh, &frame);
    let areas: Vec<f64> = (0..unit.triangles.len()).map(|t| 0.5 * f64::from(unit.area_vector(t).length())).collect();
    let mut simplifier = Simplifier::new(&unit, &areas, 0.0);
    simplifier.run(faces);
    from_unit_sphere(simplifier.mesh(), &frame)
}

fn best_shapes(inputs: &Inputs<'_>, params: &Params, context: &Context<'_>) -> Result<Vec<Shape>, Error> {
    if params.cards
        && let Some(shapes) = cards::shapes(inputs, params)
    {
        context.check(&inputs.model.name)?;
        return Ok(shapes);
    }
    let scorer = Scorer::new(inputs);
    let mut selections: Vec<Selection> = params.budgets.iter().map(|_| Selection::default()).collect();
    let generate = |candidates: &[Candidate], selections: &mut [Selection]| {
        generate_and_score(inputs, params, candidates, &scorer, selections, context)
    };
    generate(&first_candidates(params).collect::<Vec<_>>(), &mut selections)?;
    let fine = params.fine.filter(|_| !select::source_serves(&selections));
    let thick = params.thick.filter(|_| selections.last().is_some_and(Selection::wants_thick));
    let further: Vec<Candidate> = fine.into_iter().chain(thick).map(Candidate::Reconstruction).collect();
    generate(&further, &mut selections)?;
    if selections.iter().any(Selection::is_empty) {
        // A coarse, thick reconstruction has few handles to get stuck on.
        for candidate in [96, 64, 32].map(|n| Candidate::Reconstruction(Reconstruction::thick(n))) {
            let mut spare: Vec<Selection> = params.budgets.iter().map(|_| Selection::default()).collect();
            generate(&[candidate], &mut spare)?;
            for (selection, spare) in selections.iter_mut().zip(spare) {
                if selection.is_empty() {
                    *selection = spare;
                }
            }
        }
    }
    if let Some(finer) = params.finer
        && selections.iter().any(Selection::wants_finer)
    {
        generate(&[Candidate::Reconstruction(finer)], &mut selections)?;
    }
    let found: Option<Vec<Shape>> = selections.into_iter().map(Selection::into_best).collect();
    found.ok_or_else(|| {
        Error::invalid(
            &inputs.model.name,
            StageId::Shape,
            format!("no mesh of at most {} faces was found", params.budgets.first().copied().unwrap_or(0)),
            "raise the smallest budget in `faces`",
        )
    })
}

/// The quick candidates, which are always walked.
fn first_candidates(params: &Params) -> impl Iterator<Item = Candidate> {
    params.reconstruction.map(Candidate::Reconstruction).into_iter().chain(params.source.then_some(Candidate::Source))
}

/// Faces of a mesh that pass through others.
fn self_intersecting_faces(mesh: &TriMesh) -> usize {
    self_intersecting(mesh).into_iter().filter(|face| *face).count()
}

/// What shapes are judged by.
struct Scorer<'a> {
    views: Vec<&'a View>,
    /// A factor for each of their pixels; empty if all count alike.
    weights: Vec<Vec<f32>>,
}

impl<'a> Scorer<'a> {
    fn new(inputs: &Inputs<'a>) -> Self {
        let views: Vec<&View> = inputs.views.iter().step_by(3).collect();
        let weights = inputs.importance.map(|i| i.of_pixels(inputs.model, inputs.poses, &views)).unwrap_or_default();
        Self { views, weights }
    }

    fn score(&self, inputs: &Inputs<'_>, shape: &mut Shape) {
        let (mesh, double_sided) = (&shape.mesh, shape.double_sided);
        let motions = inputs.motions(mesh);
        let render_error = score::render_error(mesh, &motions, double_sided, &self.views, &self.weights);
        let (deviation, self_intersecting) = (inputs.deviation_metric.measure(mesh), self_intersecting_faces(mesh));
        (shape.render_error, shape.deviation, shape.self_intersecting) = (render_error, deviation, self_intersecting);
    }
}

/// Walks the candidates and enters what they lead to into the selections.
fn generate_and_score(
    inputs: &Inputs<'_>,
    params: &Params,
    candidates: &[Candidate],
    scorer: &Scorer<'_>,
    selections: &mut [Selection],
    context: &Context<'_>,
) -> Result<(), Error> {
    let form = context.key(|| form_key(inputs));
    let generate_candidate = |&candidate| {
        let key = form.map(|form| candidate_key(&form, params, candidate));
        context.stored(key, || Ok(generate_candidate(inputs, params, candidate)))
    };
    let walked: Result<Vec<Vec<Shape>>, Error> = candidates.par_iter().map(generate_candidate).collect();
    context.check(&inputs.model.name)?;
    let in_budget = |(selection, shape): &(usize, Shape)| {
        (1..=params.budgets[*selection] as usize).contains(&shape.mesh.triangles.len())
    };
    let by_contest =
        |shapes: Vec<Shape>| shapes.into_iter().enumerate().map(|(i, shape)| (i % selections.len(), shape));
    let mut offered: Vec<(usize, Shape)> = walked?.into_iter().flat_map(by_contest).filter(in_budget).collect();
    offered.par_iter_mut().try_for_each(|(_, shape)| {
        scorer.score(inputs, shape);
        context.check(&inputs.model.name)
    })?;
    for (selection, shape) in offered {
        let Shape { candidate, render_error: error, deviation, self_intersecting, .. } = &shape;
        let (budget, faces) = (params.budgets[selection], shape.mesh.triangles.len());
        tracing::debug!(%candidate, budget, faces, error, distance = deviation.mean, self_intersecting, "candidate");
        selections[selection].enter(shape);
    }
    Ok(())
}

/// Shapes for each budget along a candidate, in their order, once or more. Reads no texture.
fn generate_candidate(inputs: &Inputs<'_>, params: &Params, candidate: Candidate) -> Vec<Shape> {
    simplify_to_budgets(inputs, params, candidate, &input(inputs, params, candidate))
}
