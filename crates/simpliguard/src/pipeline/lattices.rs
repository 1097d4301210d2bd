//! Levels with cards in place of lattices.

use super::extra_layers;
use super::layers::{self, LayerKind, SourceLayers};
use super::level_maker::{LevelMaker, Made};
use super::source::{PreparedSource, SourceIndex};
use super::store;
use super::views::Views;
use crate::data::{Level, Model};
use crate::simplify::Lattice;
use crate::{Error, Source, StageId};

/// Faces of the smallest level for each lattice that may become a card of two faces.
const FACES_PER_LATTICE: usize = 25;
/// Faces of a card: one for each side.
pub(super) const FACES_PER_CARD: u32 = 2;
/// A bar of a lattice is lost if the share of a budget leaves it fewer faces than this.
const FACES_PER_BAR: f64 = 2.5;

/// Cards in place of lattices.
pub(super) struct LatticeCards {
    /// The source without its lattices.
    pub(super) rest: Model,
    /// The cards of levels, each by the index of its level.
    pub(super) levels: Vec<(usize, Level)>,
}

/// Makes levels again that have few faces for each bar of the source's lattices, with cards for these. The levels that look
/// more like the source stay.
///
/// Returns the cards alone for levels that may be reductions of the rest, if any.
pub(super) fn replace(
    source: &Source<'_>,
    maker: &mut LevelMaker<'_>,
    made: &mut Made,
) -> Result<Option<LatticeCards>, Error> {
    let (whole, params, run) = (maker.source.index.whole, maker.params, maker.run);
    let budgets: Vec<u32> = made.reports.iter().map(|report| report.budget).collect();
    if !params.candidates.cards || maker.pictures.is_none() {
        return Ok(None);
    }
    let most = budgets.first().map_or(0, |budget| *budget as usize / FACES_PER_LATTICE);
    let lattices = run.time(StageId::Simplify, || layers::lattices(whole, most));
    let levels = |is_wanted: &dyn Fn(u32) -> bool| -> Vec<usize> {
        (0..budgets.len()).filter(|&i| !lattices.is_empty() && is_wanted(budgets[i])).collect()
    };
    let crowded = levels(&|budget| is_crowded(&lattices, budget, maker.source_faces()));
    let reducible = levels(&|budget| maker.may_reduce(budget));
    if crowded.is_empty() && reducible.is_empty() {
        return Ok(None);
    }
    let layers = run.time(StageId::Import, || SourceLayers::divide(whole, &lattices));
    let run = run.silent();
    let index = SourceIndex::new(source, (whole, &layers.solid), &params.views, &run)?;
    let prepared = PreparedSource::new(&index, params, &run)?;
    let extra = extra_layers::index_layers(source, (whole, &layers), params, &run)?;
    let mut with_cards = LevelMaker {
        source: &prepared,
        extra: &extra,
        has_solid: true,
        views: Views::render(&index, params, &run)?,
        pictures: maker.pictures.clone(),
        content: maker.content.map(|content| store::lattices_key(&content)),
        params,
        run: &run,
    };
    for i in crowded {
        let again = with_cards.make_again(i, budgets[i])?;
        if again.1.mean_psnr() > made.reports[i].mean_psnr() {
            (made.levels[i], made.reports[i]) = again;
        }
    }
    let alone = LevelMaker { extra: lattices_alone(&extra), has_solid: false, content: None, ..with_cards };
    cards_alone(alone, &lattices, &reducible)
}

/// Makes the cards of some levels without anything else.
fn cards_alone(
    mut maker: LevelMaker<'_>,
    lattices: &[Lattice],
    levels: &[usize],
) -> Result<Option<LatticeCards>, Error> {
    if levels.is_empty() {
        return Ok(None);
    }
    let mut make = |&i: &usize| {
        let (mut level, _) = maker.make_again(i, FACES_PER_CARD * lattices.len() as u32)?;
        // Bars are too thin for their relief.
        level.textures.normal = None;
        level.mesh.tangents.clear();
        Ok((i, level))
    };
    let levels = levels.iter().map(&mut make).collect::<Result<_, Error>>()?;
    let whole = maker.source.index.whole;
    let mut is_rest = vec![true; whole.surface.triangles.len()];
    lattices.iter().flat_map(|lattice| &lattice.triangles).for_each(|&t| is_rest[t as usize] = false);
    let rest: Vec<u32> = is_rest.iter().zip(0..).filter(|(is_rest, _)| **is_rest).map(|(_, t)| t).collect();
    let rest = whole.with_surface(whole.surface.subset(&rest), whole.materials.clone());
    Ok(Some(LatticeCards { rest, levels }))
}

/// The lattices of a source's layers beside the solid one.
fn lattices_alone<'e, 'a>(extra: &'e [(LayerKind, SourceIndex<'a>)]) -> &'e [(LayerKind, SourceIndex<'a>)] {
    let count = extra.iter().take_while(|(kind, _)| matches!(kind, LayerKind::Lattices(_))).count();
    &extra[..count]
}

/// The lattices' share of a budget leaves few faces for each of their bars.
fn is_crowded(lattices: &[Lattice], budget: u32, source_faces: usize) -> bool {
    let triangles: usize = lattices.iter().map(|lattice| lattice.triangles.len()).sum();
    let bars: u32 = lattices.iter().map(|lattice| lattice.bars).sum();
    let share = triangles as f64 * f64::from(budget) / source_faces.max(1) as f64;
    share < FACES_PER_BAR * f64::from(bars)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_is_crowded_where_bars_have_few_faces() {
        let lattice = Lattice { triangles: (0..3000).collect(), bars: 100 };
        let is_crowded = |budget| is_crowded(std::slice::from_ref(&lattice), budget, 48_000);
        assert!(is_crowded(1000) && is_crowded(3900) && !is_crowded(4001));
        assert!(!super::is_crowded(&[], 1000, 48_000));
    }
}
