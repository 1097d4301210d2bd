//! The layers of the levels beside the solid one: clear surfaces, and lattices as cards.

use super::layers::{CUTOFF, LayerKind, SourceLayers};
use super::params::Params;
use super::runner::Runner;
use super::source::{PreparedSource, SourceIndex, StageTools};
use super::targets::Targets;
use crate::data::{AlphaMode, Material, Model, Transmission, area_vector};
use crate::simplify::{self, ClearPixels, LayerShape, SimplifyParams};
use crate::{Error, Source, StageId};

/// Fewest faces of a solid layer.
const FEWEST_SOLID: u32 = 4;

/// The layers of all levels beside the solid one.
pub(super) struct ExtraLayers<'a> {
    /// The budgets of whole levels, ascending.
    budgets: Vec<u32>,
    layers: Vec<ExtraLayer<'a>>,
    /// There is no solid layer.
    pub(super) is_alone: bool,
}

/// One layer of all levels.
pub(super) struct ExtraLayer<'a> {
    pub(super) source: PreparedSource<'a>,
    /// One for each budget, if the layer fits in.
    shapes: Vec<Option<LayerShape>>,
    pub(super) alpha_mode: AlphaMode,
    pub(super) transmission: Option<Transmission>,
}

/// The layers of a source beside the solid one, with the index of each.
pub(super) fn index_layers<'l>(
    source: &Source<'_>,
    (whole, layers): (&'l Model, &'l SourceLayers<'_>),
    params: &Params,
    run: &Runner<'_>,
) -> Result<Vec<(LayerKind, SourceIndex<'l>)>, Error> {
    let index = |(kind, model): &'l (LayerKind, Model)| {
        Ok((kind.clone(), SourceIndex::new(source, (whole, model), &params.views, run)?))
    };
    layers.extra.iter().map(index).collect()
}

impl<'a> ExtraLayers<'a> {
    /// Finds cards for lattices, and collapses clear layers to their shares of the budgets; to all of it if there is no solid
    /// layer. If a budget cannot be met then, there are no such layers: the source is made as a solid one.
    pub(super) fn find(
        indices: &'a [(LayerKind, SourceIndex<'a>)],
        solid: (&SourceIndex<'_>, bool),
        params: &Params,
        targets: &Targets,
        run: &Runner<'_>,
    ) -> Result<Self, Error> {
        let budgets = targets.budgets();
        let layer = |(kind, index): &'a (LayerKind, SourceIndex<'a>)| {
            ExtraLayer::new((kind, index), solid, params, &budgets, run)
        };
        let layers = run.run(StageId::Simplify, || indices.iter().map(layer).collect::<Result<Vec<_>, Error>>())??;
        Ok(Self::checked(budgets, layers, solid.1))
    }

    fn checked(budgets: Vec<u32>, layers: Vec<ExtraLayer<'a>>, has_solid: bool) -> Self {
        let fits = |level: usize| layers.iter().any(|layer| layer.shapes[level].is_some());
        if !has_solid && (0..budgets.len()).all(fits) {
            return Self { budgets, layers, is_alone: true };
        }
        Self { budgets, layers: if has_solid { layers } else { Vec::new() }, is_alone: false }
    }

    /// The budgets that are left for the solid layer.
    pub(super) fn solid_budgets(&self) -> Vec<u32> {
        let faces = |budget| self.of(budget).map(|(_, shape)| shape.mesh.triangles.len() as u32).sum::<u32>();
        self.budgets.iter().map(|&budget| budget.saturating_sub(faces(budget)).max(FEWEST_SOLID)).collect()
    }

    /// The layers of the level of a budget.
    pub(super) fn of(&self, budget: u32) -> impl Iterator<Item = (&ExtraLayer<'a>, &LayerShape)> {
        let level = self.budgets.iter().position(|&b| b == budget);
        self.layers.iter().filter_map(move |layer| Some((layer, layer.shapes.get(level?)?.as_ref()?)))
    }

    /// Notes on levels without one of the clear layers.
    pub(super) fn notes(&self) -> Vec<String> {
        let lost = |layer: &ExtraLayer<'_>| layer.shapes.iter().zip(&self.budgets).filter(|(s, _)| s.is_none()).count();
        let lost: usize = self.layers.iter().map(lost).sum();
        let note =
            || format!("{lost} levels leave out clear surfaces, which did not fit into their share of the faces");
        (lost > 0).then(note).into_iter().collect()
    }
}

impl<'a> ExtraLayer<'a> {
    fn new(
        (kind, index): (&LayerKind, &'a SourceIndex<'a>),
        (solid, has_solid): (&SourceIndex<'_>, bool),
        params: &Params,
        budgets: &[u32],
        run: &Runner<'_>,
    ) -> Result<Self, Error> {
        let model = index.model;
        let source = PreparedSource { joint_planes: Vec::new(), ..PreparedSource::new(index, params, run)? };
        if let LayerKind::Lattices(lattice) = kind {
            let shape = simplify::lattice_cards(model, lattice);
            let alpha_mode = AlphaMode::Mask { cutoff: CUTOFF };
            return Ok(Self { source, shapes: vec![Some(shape); budgets.len()], alpha_mode, transmission: None });
        }
        let sphere = solid.sphere.with(&index.sphere);
        let occluder = has_solid.then_some((solid.model, &solid.opaque));
        let pixels = ClearPixels::count(model, occluder, &sphere, run.cancellation());
        let shares = budgets.iter().map(|&budget| if has_solid { pixels.share(budget) } else { budget }).collect();
        let shapes = collapse(&source, shares, &pixels, (params, run));
        let is_blended = model.surface.material.first().is_some_and(|&m| is_blended(model, m));
        let alpha_mode = if is_blended { AlphaMode::Blend } else { AlphaMode::Opaque };
        Ok(Self { source, shapes, alpha_mode, transmission: transmission(model) })
    }

    /// The layer reflects no light.
    pub(super) fn is_unlit(&self) -> bool {
        let model = self.source.index.model;
        model.surface.material.iter().all(|&m| model.materials[m as usize].unlit)
    }
}

fn collapse(
    source: &PreparedSource<'_>,
    budgets: Vec<u32>,
    pixels: &ClearPixels,
    (params, run): (&Params, &Runner<'_>),
) -> Vec<Option<LayerShape>> {
    let tools = StageTools { source, run };
    let params = SimplifyParams { budgets, candidates: params.candidates, collapse: params.collapse };
    simplify::simplify_clear(&tools.inputs(&[]), &params, pixels)
}

fn is_blended(model: &Model, material: u32) -> bool {
    model.materials[material as usize].alpha_mode == AlphaMode::Blend
}

/// The transmission of most of a model's area, if it has one.
pub(super) fn transmission(model: &Model) -> Option<Transmission> {
    let surface = &model.surface;
    let mut areas = vec![0.0; model.materials.len()];
    for (triangle, &material) in surface.triangles.iter().zip(&surface.material) {
        let corners = triangle.map(|v| surface.positions[v as usize]);
        areas[material as usize] += f64::from(area_vector(corners).length());
    }
    let transmits = |(area, material): (&f64, &Material)| material.transmission.map(|t| (*area, t));
    let all: Vec<(f64, Transmission)> = areas.iter().zip(&model.materials).filter_map(transmits).collect();
    let transmitting: f64 = all.iter().map(|(area, _)| area).sum();
    let largest = all.iter().max_by(|a, b| a.0.total_cmp(&b.0))?.1;
    (transmitting > 0.5 * areas.iter().sum::<f64>()).then_some(largest)
}
