//! Levels that keep the source's materials, where its own triangles can mostly stay.

use super::lattices::LatticeCards;
use super::level_maker::{LevelMaker, Made};
use super::reduced_level;
use super::report::LevelReport;
use super::runner::Runner;
use super::source::SourceIndex;
use crate::data::{Level, Model};
use crate::simplify::{self, Importance, Reduced, ReductionInputs};
use crate::{Error, Source, StageId};

/// Decibels by which a level with the source's materials must look more like the source, for each draw call that it costs more
/// than a level with one material.
const DECIBELS_PER_DRAW_CALL: f32 = 0.1;

/// Decibels by which it must look more like the source, for each that it loses in its worst view.
const WORST_VIEW: f32 = 3.0;
/// Decibels by which it may look less like the source, for each that it gains in its worst view.
const BETTER_WORST_VIEW: f32 = 0.25;
/// Decibels by which it must look more like the source if it shows a whole material wrongly that the other shows rightly, and
/// in proportion for a part of it. A mangled pot in a large room is few pixels.
const WRONG_MATERIAL: f32 = 10.0;
/// Decibels of a view in which nothing is missing.
const SOUND_VIEW: f32 = 30.0;

/// A level that may keep the source's materials.
#[derive(Clone, Copy)]
struct Attempt<'a> {
    /// Its index among the levels.
    level: usize,
    budget: u32,
    /// Cards in place of the source's lattices.
    cards: Option<&'a Level>,
}

/// Reduces the source to budgets that are a good part of it; also beside cards, where levels have some for lattices. The levels
/// that look more like it stay.
pub(super) fn replace(
    source: &Source<'_>,
    maker: &LevelMaker<'_>,
    cards: Option<&LatticeCards>,
    made: &mut Made,
) -> Result<(), Error> {
    let model = maker.source.index.whole;
    let budgets: Vec<u32> = made.reports.iter().map(|report| report.budget).collect();
    let attempt = |level: usize, cards| {
        let budget = budgets[level];
        maker.may_reduce(budget).then_some(Attempt { level, budget, cards })
    };
    let plain: Vec<Attempt<'_>> = (0..budgets.len()).filter_map(|level| attempt(level, None)).collect();
    try_all(source, maker, (model, &plain), made)?;
    let Some(LatticeCards { rest, levels }) = cards else { return Ok(()) };
    let with_cards = levels.iter().filter_map(|(level, cards)| attempt(*level, Some(cards)));
    try_all(source, maker, (rest, &with_cards.collect::<Vec<_>>()), made)
}

/// Reduces a model to several budgets.
fn try_all(
    source: &Source<'_>,
    maker: &LevelMaker<'_>,
    (model, attempts): (&Model, &[Attempt<'_>]),
    made: &mut Made,
) -> Result<(), Error> {
    if attempts.is_empty() {
        return Ok(());
    }
    let faces_of = |cards: &Level| cards.mesh.triangles.len() as u32;
    let budget = |attempt: &Attempt<'_>| attempt.budget.saturating_sub(attempt.cards.map_or(0, faces_of));
    let budgets: Vec<u32> = attempts.iter().map(budget).collect();
    let reduced = maker.run.time(StageId::Simplify, || reduce(source, maker, model, &budgets))?;
    for (attempt, reduced) in attempts.iter().zip(reduced) {
        if let Some(reduced) = reduced {
            keep_better(maker, *attempt, &reduced, made);
        }
    }
    Ok(())
}

/// Keeps a reduced level if it looks more like the source than the one that is there, also in its worst view.
fn keep_better(maker: &LevelMaker<'_>, attempt: Attempt<'_>, reduced: &Reduced, made: &mut Made) {
    let Some(pictures) = &maker.pictures else { return };
    let (there, there_report) = (&made.levels[attempt.level], &made.reports[attempt.level]);
    let level = reduced_level::level(&reduced.surface, attempt.cards, there);
    maker.run.validate(StageId::Simplify, || level.validate());
    let likeness = maker.run.time(StageId::Views, || pictures.compare(&level));
    let draw_calls = level.layers.len().saturating_sub(there.layers.len());
    let report = reduced_level::report(maker, reduced, &level, there_report);
    let level = Level { error: report.error, ..level };
    let report = LevelReport { likeness: Some(likeness), ..report };
    let gain = report.mean_psnr() - there_report.mean_psnr();
    // Walls that are exact in most views must not hide bars that are missing in one.
    let loss = there_report.worst_psnr().min(SOUND_VIEW) - report.worst_psnr().min(SOUND_VIEW);
    let of_worst_view = if loss > 0.0 { WORST_VIEW * loss } else { BETTER_WORST_VIEW * loss };
    let wrong = (report.wrong_share() - there_report.wrong_share()).max(0.0);
    tracing::debug!(budget = report.budget, gain, draw_calls, wrong, cards = report.lattices, "reduction");
    if gain > DECIBELS_PER_DRAW_CALL * draw_calls as f32 + of_worst_view + WRONG_MATERIAL * wrong {
        let warning = maker.params.gate.warning(&report);
        (made.levels[attempt.level], made.reports[attempt.level]) = (level, LevelReport { warning, ..report });
    }
}

fn reduce(
    source: &Source<'_>,
    maker: &LevelMaker<'_>,
    model: &Model,
    budgets: &[u32],
) -> Result<Vec<Option<Reduced>>, Error> {
    let LevelMaker { params, run, .. } = *maker;
    let index = maker.source.index;
    if std::ptr::eq(index.model, model) {
        return Ok(reduce_indexed(index, maker.source.importance.as_ref(), maker, budgets));
    }
    let run: Runner<'_> = run.silent();
    let index = SourceIndex::new(source, (index.whole, model), &params.views, &run)?;
    let importance = Importance::of(model, &params.importance)?;
    Ok(reduce_indexed(&index, importance.as_ref(), maker, budgets))
}

fn reduce_indexed(
    index: &SourceIndex<'_>,
    importance: Option<&Importance>,
    maker: &LevelMaker<'_>,
    budgets: &[u32],
) -> Vec<Option<Reduced>> {
    let inputs = ReductionInputs {
        model: index.model,
        poses: index.poses.as_ref(),
        importance,
        params: &maker.params.collapse,
        cancellation: maker.run.cancellation(),
    };
    simplify::reduce(&inputs, budgets)
}
