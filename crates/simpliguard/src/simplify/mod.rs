//! Low-poly meshes of exact budgets.
//!
//! Several candidates compete for each budget: reconstructions at different resolutions, and the source's own triangles,
//! welded and cut into a manifold. Faces that no view reaches go first. Then edges collapse by quadric error, weighted by
//! the visible size of each face. Each result is scored by rendering it against the source, and the best is kept, so
//! that a model that suits plain edge collapse does not lose by the reconstruction. The quick candidates come first and
//! decide whether the others are worth their time.
//!
//! The result is a manifold. It has a boundary only where nothing sees it or where the source has one.

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
mod self_intersection;
mod shape;
mod unit_sphere;
mod visibility;
mod weld;

use rayon::prelude::*;

use crate::data::{Candidate, Reconstruction, TriMesh};
use crate::geometry::BoundingSphere;
use crate::{Error, StageId};
use budgets::simplify_to_budgets;
use candidates::cards;
use input::SimplifyInput;
use qem::Simplifier;
use score::Scorer;
use select::Selection;
use unit_sphere::{from_unit_sphere, to_unit_sphere};

pub use deviation::DeviationMetric;
pub use importance::{Importance, ImportanceParams};
pub use inputs::{Inputs, Tools};
pub use opaque::OpaqueSurface;
pub use params::{CandidateParams, CollapseParams, SimplifyParams};
pub use shape::{Shape, Shortfall};
pub use visibility::texel_density;

/// Distance by which coincident vertices are moved apart, as a fraction of the radius of the bounding sphere.
const PARTED: f32 = 2e-5;
/// Resolutions of the reconstructions for budgets that no other candidate meets. Coarse, thick ones have few handles that
/// a collapse gets stuck on.
const SPARE_RESOLUTIONS: [u32; 3] = [96, 64, 32];

/// Generates the shapes of one candidate, as [`generate`] does, or finds them where an earlier bake has stored them.
pub type Generate<'a> = &'a (dyn Fn(Candidate) -> Result<Vec<Shape>, Error> + Sync);

/// Finds the best shape for each budget, in their order.
///
/// # Errors
/// If cancelled, or if no candidate meets a budget.
pub fn simplify(inputs: &Inputs<'_>, params: &SimplifyParams, generate: Generate<'_>) -> Result<Vec<Shape>, Error> {
    let foliage = params.candidates.cards.then(|| cards::shapes(inputs, params)).flatten();
    let mut shapes = match foliage {
        Some(shapes) => shapes,
        None => Competition::new(inputs, params, generate).run()?,
    };
    inputs.cancellation.check(&inputs.model.name)?;
    for shape in &mut shapes {
        weld::part_coincident(&mut shape.mesh, PARTED * inputs.sphere.radius);
    }
    Ok(shapes)
}

/// Shapes of a candidate for each budget, in their order, once or more. Reads no texture.
pub fn generate(inputs: &Inputs<'_>, params: &SimplifyParams, candidate: Candidate) -> Vec<Shape> {
    let input = SimplifyInput::of(inputs, params.collapse.remove_invisible, candidate);
    simplify_to_budgets(inputs, params, candidate, &input)
}

/// Collapses a manifold mesh, with or without boundary, to at most `faces` faces by plain quadric error: the step that the
/// candidates share, without a source to compare with.
pub fn collapse(mesh: &TriMesh, faces: usize) -> TriMesh {
    let sphere = BoundingSphere::around(&mesh.positions);
    let unit = to_unit_sphere(mesh, &sphere);
    let areas: Vec<f64> = (0..unit.triangles.len()).map(|t| 0.5 * f64::from(unit.area_vector(t).length())).collect();
    let mut simplifier = Simplifier::new(&unit, &areas, 0.0);
    simplifier.run(faces);
    from_unit_sphere(simplifier.mesh(), &sphere)
}

/// Candidates, one [`Selection`] for each budget.
struct Competition<'a> {
    inputs: &'a Inputs<'a>,
    params: &'a SimplifyParams,
    generate: Generate<'a>,
    scorer: Scorer<'a>,
}

impl<'a> Competition<'a> {
    fn new(inputs: &'a Inputs<'a>, params: &'a SimplifyParams, generate: Generate<'a>) -> Self {
        Self { inputs, params, generate, scorer: Scorer::new(inputs) }
    }

    /// Generates and scores candidates as long as they may be better; returns the best shape for each budget.
    fn run(&self) -> Result<Vec<Shape>, Error> {
        let params = &self.params.candidates;
        let mut selections = self.empty();
        self.add(&params.first().collect::<Vec<_>>(), &mut selections)?;
        let fine = params.fine.filter(|_| !select::source_serves(&selections));
        let thick = params.thick.filter(|_| selections.last().is_some_and(Selection::wants_thick));
        let further: Vec<Candidate> = fine.into_iter().chain(thick).map(Candidate::Reconstruction).collect();
        self.add(&further, &mut selections)?;
        if selections.iter().any(Selection::is_empty) {
            self.add_spare(&mut selections)?;
        }
        if let Some(finer) = params.finer
            && selections.iter().any(Selection::wants_finer)
        {
            self.add(&[Candidate::Reconstruction(finer)], &mut selections)?;
        }
        let found: Option<Vec<Shape>> = selections.into_iter().map(Selection::into_best).collect();
        found.ok_or_else(|| self.no_shape())
    }

    fn empty(&self) -> Vec<Selection> {
        self.params.budgets.iter().map(|_| Selection::default()).collect()
    }

    /// Fills the selections that are still empty.
    fn add_spare(&self, selections: &mut [Selection]) -> Result<(), Error> {
        for resolution in SPARE_RESOLUTIONS {
            let mut spare = self.empty();
            self.add(&[Candidate::Reconstruction(Reconstruction::thick(resolution))], &mut spare)?;
            for (selection, spare) in selections.iter_mut().zip(spare) {
                if selection.is_empty() {
                    *selection = spare;
                }
            }
        }
        Ok(())
    }

    /// Generates candidates side by side, scores their shapes, and adds each shape to the selection of its budget.
    fn add(&self, candidates: &[Candidate], selections: &mut [Selection]) -> Result<(), Error> {
        let asset = &self.inputs.model.name;
        let generated: Result<Vec<Vec<Shape>>, Error> = candidates.par_iter().map(|&c| (self.generate)(c)).collect();
        self.inputs.cancellation.check(asset)?;
        let budgets = &self.params.budgets;
        let in_budget =
            |(budget, shape): &(usize, Shape)| (1..=budgets[*budget] as usize).contains(&shape.mesh.triangles.len());
        let by_budget =
            |shapes: Vec<Shape>| shapes.into_iter().enumerate().map(|(i, shape)| (i % budgets.len(), shape));
        let mut shapes: Vec<(usize, Shape)> = generated?.into_iter().flat_map(by_budget).filter(in_budget).collect();
        shapes.par_iter_mut().try_for_each(|(_, shape)| {
            self.scorer.score(self.inputs, shape);
            self.inputs.cancellation.check(asset)
        })?;
        for (i, shape) in shapes {
            let Shape { candidate, render_error: error, deviation, self_intersecting, .. } = &shape;
            let (budget, faces) = (budgets[i], shape.mesh.triangles.len());
            tracing::debug!(%candidate, budget, faces, error, distance = deviation.mean, self_intersecting, "candidate");
            selections[i].add(shape);
        }
        Ok(())
    }

    fn no_shape(&self) -> Error {
        let smallest = self.params.budgets.first().copied().unwrap_or(0);
        let found = format!("no mesh of at most {smallest} faces was found");
        Error::invalid(&self.inputs.model.name, StageId::Simplify, found, "raise the smallest budget in `faces`")
    }
}
