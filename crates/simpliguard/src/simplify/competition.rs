//! The competition of candidates for each budget.

use rayon::prelude::*;

use super::inputs::Inputs;
use super::params::SimplifyParams;
use super::score::Scorer;
use super::select::{self, Selection};
use super::shape::{RunnerUp, Selected, Shape};
use crate::data::{Candidate, Reconstruction};
use crate::{Error, StageId};

/// Resolutions of the reconstructions for budgets that no other candidate meets. Coarse, thick ones have few of the
/// handles that block a collapse.
const SPARE_RESOLUTIONS: [u32; 3] = [96, 64, 32];

/// The source's own triangles replace cards if the error of the cards is this many times theirs. The score does not know
/// that leaves on cards grow to the area of the source's leaves.
const CLEARLY_BETTER: f64 = 1.25;

/// Generates the shapes of one candidate, as [`super::generate`] does, or reads them from the store.
pub type Generate<'a> = &'a (dyn Fn(Candidate) -> Result<Vec<Shape>, Error> + Sync);

/// The candidates of one source, with one [`Selection`] for each budget.
pub(super) struct Competition<'a> {
    inputs: &'a Inputs<'a>,
    params: &'a SimplifyParams,
    generate: Generate<'a>,
    scorer: Scorer<'a>,
}

impl<'a> Competition<'a> {
    pub(super) fn new(inputs: &'a Inputs<'a>, params: &'a SimplifyParams, generate: Generate<'a>) -> Self {
        Self { inputs, params, generate, scorer: Scorer::new(inputs) }
    }

    /// Generates and scores candidates as long as they may win. Returns the best shape for each budget.
    ///
    /// # Errors
    /// If cancelled, or if no candidate meets a budget.
    pub(super) fn run(&self) -> Result<Vec<Selected>, Error> {
        let params = &self.params.candidates;
        let mut selections = self.empty_selections();
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
        let found: Option<Vec<Selected>> = selections.into_iter().map(Selection::into_selected).collect();
        found.ok_or_else(|| self.no_shape())
    }

    /// For foliage: the cards for each budget compete with the source's own triangles, by their pictures alone. The distance
    /// of a card to its leaves says nothing, and a reconstruction is a blob.
    ///
    /// # Errors
    /// If cancelled.
    pub(super) fn run_with_cards(&self, mut cards: Vec<Shape>) -> Result<Vec<Selected>, Error> {
        let mut selections = self.empty_selections();
        if self.params.candidates.source {
            self.add(&[Candidate::Source], &mut selections)?;
        }
        cards.par_iter_mut().for_each(|shape| self.scorer.score(self.inputs, shape));
        let select = |(cards, selection): (Shape, Selection)| {
            let Some(source) = selection.into_selected().map(|source| source.best) else {
                return Selected { best: cards, runner_up: None };
            };
            let ratio = source.render_error * CLEARLY_BETTER / cards.render_error;
            let [best, other] = if ratio < 1.0 { [source, cards] } else { [cards, source] };
            let relative_score = if ratio < 1.0 { ratio.recip() } else { ratio };
            Selected { best, runner_up: Some(RunnerUp { shape: other, relative_score }) }
        };
        Ok(cards.into_iter().zip(selections).map(select).collect())
    }

    fn empty_selections(&self) -> Vec<Selection> {
        self.params.budgets.iter().map(|_| Selection::default()).collect()
    }

    /// Fills the selections that are still empty.
    fn add_spare(&self, selections: &mut [Selection]) -> Result<(), Error> {
        for resolution in SPARE_RESOLUTIONS {
            let mut spare = self.empty_selections();
            self.add(&[Candidate::Reconstruction(Reconstruction::thick(resolution))], &mut spare)?;
            for (selection, spare) in selections.iter_mut().zip(spare) {
                if selection.is_empty() {
                    *selection = spare;
                }
            }
        }
        Ok(())
    }

    /// Generates candidates in parallel, scores their shapes, and adds each shape to the selection of its budget.
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
