//! Low-poly meshes of exact budgets.
//!
//! Several candidates compete for each budget: reconstructions at different resolutions, and the source's own
//! triangles, welded and cut into a manifold. Faces that no view sees are removed first. Then edges collapse by quadric
//! error, weighted by the visible size of each face. Each result is rendered and scored against the source, and the
//! best one is kept. So a model that suits plain edge collapse loses nothing by the reconstruction. The quick
//! candidates come first; their scores decide whether the others are generated.
//!
//! The result is a manifold. It has a boundary only where nothing sees it or where the source has one.

mod budgets;
mod candidates;
mod clear;
mod clear_pixels;
mod competition;
mod deviation;
mod enclosed;
mod face_weights;
mod importance;
mod inputs;
mod lattices;
mod layer_shape;
mod opaque;
mod oriented_box;
mod params;
mod qem;
mod reduction;
mod score;
mod select;
mod shape;
mod simplify_input;
mod stitch;
mod unit_sphere;
mod visibility;
mod walls;
mod weld;

use crate::Error;
use crate::data::{Candidate, TriMesh};
use crate::geometry::BoundingSphere;
use budgets::simplify_to_budgets;
use candidates::cards;
use competition::Competition;
use face_weights::face_areas;
use qem::Simplifier;
use simplify_input::SimplifyInput;
use unit_sphere::{from_unit_sphere, to_unit_sphere};

pub use clear::simplify_clear;
pub use clear_pixels::ClearPixels;
pub use competition::Generate;
pub use deviation::DeviationMetric;
pub use face_weights::texel_density;
pub use importance::{Importance, ImportanceParams};
pub use inputs::{Inputs, Tools};
pub use lattices::{Lattice, find_lattices, lattice_cards};
pub use layer_shape::LayerShape;
pub use opaque::OpaqueSurface;
pub use params::{CandidateParams, CollapseParams, SimplifyParams};
pub use reduction::{Reduced, ReductionInputs, reduce};
pub use score::is_cut_out;
pub use shape::{RunnerUp, Selected, Shape, Shortfall};

/// Finds the best shape for each budget, in the order of the budgets.
///
/// # Errors
/// If cancelled, or if no candidate meets a budget.
pub fn simplify(inputs: &Inputs<'_>, params: &SimplifyParams, generate: Generate<'_>) -> Result<Vec<Selected>, Error> {
    let foliage = params.candidates.cards.then(|| cards::shapes(inputs, params)).flatten();
    let competition = Competition::new(inputs, params, generate);
    let mut selected = match foliage {
        Some(cards) => competition.run_with_cards(cards)?,
        None => competition.run()?,
    };
    inputs.cancellation.check(&inputs.model.name)?;
    for shape in selected.iter_mut().flat_map(Selected::shapes_mut) {
        weld::move_coincident_apart(&mut shape.mesh, weld::COINCIDENT_OFFSET * inputs.sphere.radius);
    }
    Ok(selected)
}

/// Generates the shapes of a candidate: one for each budget, in the order of the budgets, and then further rounds of
/// them if the candidate offers alternatives. Reads no texture.
pub fn generate(inputs: &Inputs<'_>, params: &SimplifyParams, candidate: Candidate) -> Vec<Shape> {
    let input = SimplifyInput::of(inputs, params.collapse.remove_invisible, candidate);
    simplify_to_budgets(inputs, params, candidate, &input)
}

/// Welds triangles and cuts them into a manifold mesh with boundary. Degenerate triangles are left out.
pub fn manifold(mesh: &TriMesh) -> TriMesh {
    weld::weld(&mesh.positions, &mesh.triangles).0
}

/// Collapses a manifold mesh, with or without boundary, to at most `faces` faces by plain quadric error. This is the
/// step that the candidates share, without a source to compare with.
pub fn collapse(mesh: &TriMesh, faces: usize) -> TriMesh {
    let sphere = BoundingSphere::around(&mesh.positions);
    let unit = to_unit_sphere(mesh, &sphere);
    let mut simplifier = Simplifier::new(&unit, &face_areas(&unit), 0.0);
    simplifier.run(faces);
    from_unit_sphere(simplifier.mesh(), &sphere)
}
