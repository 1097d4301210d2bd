//! Clear surfaces: glass, water, shadows that are painted on a plane.
//!
//! Nothing hides behind them, and they hide nothing of each other. So they are collapsed on their own, with all their
//! walls, and get a share of the budget by what they show in front of the solid surface.

use super::budgets::simplify_to_budgets;
use super::clear_pixels::ClearPixels;
use super::inputs::Inputs;
use super::layer_shape::LayerShape;
use super::params::SimplifyParams;
use super::simplify_input::SimplifyInput;
use super::walls::Walls;
use super::{visibility, weld};
use crate::data::{Candidate, Parts};

/// Rings of invisible faces that are kept around visible ones.
const KEPT_RINGS: usize = 1;

/// Collapses a clear surface to each of the budgets, in their order. `None` where no collapse meets a budget, and if
/// nothing of the surface is ever seen.
///
/// The components keep the order of the source: a viewer that does not sort blends them as it does those.
pub fn simplify_clear(inputs: &Inputs<'_>, params: &SimplifyParams, pixels: &ClearPixels) -> Vec<Option<LayerShape>> {
    let (mesh, welded_from) = weld::weld(&inputs.opaque.mesh.positions, &inputs.opaque.mesh.triangles);
    let source: Vec<u32> = welded_from.iter().map(|&t| inputs.opaque.source[t as usize]).collect();
    let of_source = |pixels: &[u32]| -> Vec<u32> { source.iter().map(|&t| pixels[t as usize]).collect() };
    let covered = of_source(&pixels.faces.covered);
    let is_double_sided = |t: usize| inputs.model.material_of(source[t]).double_sided;
    let double_sided = visibility::most_are_double_sided(&covered, is_double_sided);
    let mut kept: Vec<bool> = covered.iter().map(|&n| n > 0).collect();
    if !kept.contains(&true) {
        return vec![None; params.budgets.len()];
    }
    visibility::grow(&mesh, &mut kept, KEPT_RINGS);
    let weighted = of_source(&pixels.faces.weighted());
    let pixels = weighted.into_iter().zip(&kept).filter(|(_, kept)| **kept).map(|(n, _)| n).collect();
    let source: Vec<u32> = source.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(&t, _)| t).collect();
    let input = SimplifyInput { mesh: weld::cut(&mesh.filtered(|t| kept[t])), pixels, double_sided, is_clear: true };
    let walls = Walls::new(&input.mesh, &source, inputs.sphere.radius);
    let shapes = simplify_to_budgets(inputs, params, Candidate::Source, &input);
    let best = |(i, &budget): (usize, &u32)| {
        let rounds = shapes.iter().skip(i).step_by(params.budgets.len());
        let shape = rounds.into_iter().find(|s| (1..=budget as usize).contains(&s.mesh.triangles.len()))?;
        let (mut mesh, of_faces) = walls.in_source_order(&shape.mesh);
        weld::move_coincident_apart(&mut mesh, weld::COINCIDENT_OFFSET * inputs.sphere.radius);
        let parts = Parts { of_faces, of_source: walls.of_source(inputs.model.surface.triangles.len()) };
        Some(LayerShape { mesh, double_sided, cards: None, parts: Some(parts) })
    };
    params.budgets.iter().enumerate().map(best).collect()
}
