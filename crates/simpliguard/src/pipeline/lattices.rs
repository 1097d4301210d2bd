//! Levels with cards in place of lattices.

use super::extra_layers;
use super::layers::{self, SourceLayers};
use super::level_maker::{LevelMaker, Made};
use super::report::LevelReport;
use super::source::{PreparedSource, SourceIndex};
use super::store;
use super::views::Views;
use crate::simplify::Lattice;
use crate::{Error, Source, StageId};

/// Faces of the smallest level for each lattice that may become a card of two faces.
const FACES_PER_LATTICE: usize = 25;
/// A bar of a lattice is lost if the share of a budget leaves it fewer faces than this.
const FACES_PER_BAR: f64 = 2.5;

/// Makes levels again that have few faces for each bar of the source's lattices, with cards for these. The levels that look
/// more like the source stay.
pub(super) fn replace(source: &Source<'_>, maker: &mut LevelMaker<'_>, made: &mut Made) -> Result<(), Error> {
    let (whole, params, run) = (maker.source.index.whole, maker.params, maker.run);
    let smallest = made.reports.first().map_or(0, |report| report.budget) as usize;
    if !params.candidates.cards || maker.pictures.is_none() {
        return Ok(());
    }
    let find = || layers::lattices(whole, smallest / FACES_PER_LATTICE);
    let lattices = run.time(StageId::Simplify, find);
    let crowded = |report: &LevelReport| is_crowded(&lattices, report.budget, maker.source_faces());
    let crowded: Vec<usize> = (0..made.reports.len()).filter(|&i| crowded(&made.reports[i])).collect();
    if crowded.is_empty() {
        return Ok(());
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
        let again = with_cards.make_again(i, made.reports[i].budget)?;
        if again.1.mean_psnr() > made.reports[i].mean_psnr() {
            (made.levels[i], made.reports[i]) = again;
        }
    }
    Ok(())
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
