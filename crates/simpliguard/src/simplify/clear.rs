//! Clear surfaces: glass, water, shadows that are painted on a plane.
//!
//! Nothing hides behind them, and they hide nothing of each other. So they are collapsed on their own, with all their
//! walls, and get a share of the budget by what they show in front of the solid surface.

use super::budgets::simplify_to_budgets;
use super::inputs::Inputs;
use super::layer_shape::LayerShape;
use super::opaque::OpaqueSurface;
use super::params::SimplifyParams;
use super::simplify_input::SimplifyInput;
use super::visibility::{ClearPixels, DIRECTIONS};
use super::walls::Walls;
use super::{visibility, weld};
use crate::Cancellation;
use crate::data::{Candidate, Model, Parts, TriMesh};
use crate::geometry::BoundingSphere;

/// Faces of a clear surface for one face of a solid one that shows as many pixels: in front of a solid one, less of its shape
/// is seen.
const WORTH: f64 = 0.2;
/// The same where nothing solid is behind it: there its outline is that of the model.
const OPEN_WORTH: f64 = 0.4;
/// Fewest faces of a clear surface, as a fraction of the budget: the windows of a small car on a large ground are still
/// windows.
const FEWEST: f64 = 0.02;
/// The same in faces, unless that is more than half of the budget.
const FEWEST_FACES: u32 = 8;
/// Largest fraction of a budget for all clear surfaces together, where there is a solid one.
const MOST: f64 = 0.5;
/// Rings of invisible faces that are kept around visible ones.
const KEPT_RINGS: usize = 1;

impl ClearPixels {
    /// Counts the pixels of `clear`, a model of clear surfaces, in front of the solid surface of a model, if there is
    /// one.
    pub fn count(
        clear: &Model,
        solid: Option<(&Model, &OpaqueSurface)>,
        sphere: &BoundingSphere,
        cancellation: &Cancellation,
    ) -> Self {
        let clear_mesh =
            TriMesh { positions: clear.surface.positions.clone(), triangles: clear.surface.triangles.clone() };
        let is_double_sided = |t: usize| clear.material_of(t as u32).double_sided;
        let nothing = TriMesh::default();
        let solid_mesh = solid.map_or(&nothing, |(_, solid)| &solid.mesh);
        let is_solid_double_sided =
            |t: usize| solid.is_some_and(|(model, solid)| model.material_of(solid.source[t]).double_sided);
        visibility::clear_pixels(
            (&clear_mesh, &is_double_sided),
            (solid_mesh, &is_solid_double_sided),
            (sphere, DIRECTIONS),
            cancellation,
        )
    }

    /// The faces out of `budget` that the clear surface is worth.
    pub fn share(&self, budget: u32) -> u32 {
        let clear: f64 = self.faces.covered.iter().map(|&n| f64::from(n)).sum();
        let (open, solid) = (self.open as f64, self.solid as f64);
        let worth = (WORTH * (clear - open) + OPEN_WORTH * open) / (clear + solid).max(1.0);
        let faces = (f64::from(budget) * worth.clamp(FEWEST, MOST)).round() as u32;
        faces.max(FEWEST_FACES.min(budget / 2)).min(self.faces.covered.len() as u32)
    }
}

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

#[cfg(test)]
mod tests {
    use super::super::visibility::FacePixels;
    use super::*;

    #[test]
    fn a_share_follows_the_pixels_within_its_bounds() {
        let pixels = |clear: u32, solid| ClearPixels {
            faces: FacePixels { covered: vec![clear; 1000], outlines: vec![0; 1000] },
            open: 0,
            solid,
        };
        assert_eq!(pixels(1, 3000).share(1000), 50);
        assert_eq!(ClearPixels { open: 500, ..pixels(1, 3000) }.share(1000), 75);
        assert_eq!(pixels(1, 1_000_000).share(1000), 20);
        assert_eq!(pixels(1, 1_000_000).share(200), FEWEST_FACES);
        assert_eq!(pixels(1, 0).share(4000), 800);
        assert_eq!(pixels(1, 1_000_000).share(10), 5);
    }
}
