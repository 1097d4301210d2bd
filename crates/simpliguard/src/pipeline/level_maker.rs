//! Makes the levels of a source for targets.

use std::sync::Arc;

use super::extra_layers::ExtraLayers;
use super::layers::LayerKind;
use super::level_task::{LayerShapes, Levels};
use super::likeness::SourcePictures;
use super::params::Params;
use super::preview;
use super::report::LevelReport;
use super::runner::Runner;
use super::shapes::{self, Shapes};
use super::source::{PreparedSource, SourceIndex};
use super::targets::Targets;
use super::views::Views;
use crate::data::Level;
use crate::settings::Target;
use crate::{Error, Key};

/// Triangles of a source for each face of a level that may be a reduction, at most: of more, collapses that keep attributes lose
/// to those of the shape alone.
const MOST_TRIANGLES_PER_FACE: usize = 64;

/// Everything that levels are made from.
pub(super) struct LevelMaker<'a> {
    pub(super) source: &'a PreparedSource<'a>,
    /// The layers beside the solid one, with the index of each.
    pub(super) extra: &'a [(LayerKind, SourceIndex<'a>)],
    /// False if the whole source is clear.
    pub(super) has_solid: bool,
    pub(super) views: Views<'a>,
    /// Taken once the first shapes are known: a preview does not wait for them.
    pub(super) pictures: Option<Arc<SourcePictures<'a>>>,
    /// Key of the source's files, if stages are stored.
    pub(super) content: Option<Key>,
    pub(super) params: &'a Params,
    pub(super) run: &'a Runner<'a>,
}

/// The levels of a source, budgets ascending.
pub(super) struct Made {
    pub(super) levels: Vec<Level>,
    pub(super) reports: Vec<LevelReport>,
    /// What the levels do not meet or leave out, in words.
    pub(super) notes: Vec<String>,
}

impl LevelMaker<'_> {
    /// Triangles of the source.
    pub(super) fn source_faces(&self) -> usize {
        self.source.index.whole.surface.triangles.len()
    }

    /// A level of a budget may be a reduction of the source: the budget is a good part of it, and its materials use no other
    /// texture coordinates than the surface has.
    pub(super) fn may_reduce(&self, budget: u32) -> bool {
        let is_near = self.source_faces() <= MOST_TRIANGLES_PER_FACE.saturating_mul(budget as usize);
        let materials = &self.source.index.whole.materials;
        self.params.keep_materials && is_near && materials.iter().all(|material| material.uv_sets == [0, 1])
    }

    /// Makes a level for each of the targets.
    pub(super) fn make(&mut self, targets: &Targets) -> Result<Made, Error> {
        self.make_from(0, targets, self.run)
    }

    /// Makes the level with index `i` again for another budget, which is below the source's faces.
    pub(super) fn make_again(&mut self, i: usize, budget: u32) -> Result<(Level, LevelReport), Error> {
        let targets = Targets::new(&[Target::Faces(budget)], self.source_faces());
        let Made { levels, reports, .. } = self.make_from(i, &targets, &self.run.silent())?;
        let made = levels.into_iter().zip(reports).next();
        made.ok_or_else(|| Error::Settings(format!("a budget of {budget} faces is not below those of the source")))
    }

    /// Makes levels, of which the first has the index `first`.
    fn make_from(&mut self, first: usize, targets: &Targets, run: &Runner<'_>) -> Result<Made, Error> {
        let Self { source, extra, has_solid, content, params, .. } = *self;
        let extra = ExtraLayers::find(extra, (source.index, has_solid), params, targets, run)?;
        // Reconstruct and simplify.
        let shapes = match extra.is_alone {
            false => shapes::find(source, &mut self.views, params, (targets, extra.solid_budgets(), content), run)?,
            true => Shapes::empty(source, &extra, targets),
        };
        let shapes = LayerShapes { solid: &shapes, extra: &extra };
        preview::show(source, &self.views, params, shapes, run)?;
        self.views.complete(shapes.solid.need_half_resolution, params, run);
        let (index, views) = (source.index, &params.views);
        let pictures =
            Some(&**self.pictures.get_or_insert_with(|| Arc::new(SourcePictures::of(index, views, self.run))));
        // Unwrap, skinning, texture, refine and maps.
        let views = &self.views;
        let levels = Levels { source, views, params, shapes, first, pictures, warm_start: false, run };
        let (levels, reports) = levels.make()?;
        Ok(Made { levels, reports, notes: shapes.notes() })
    }
}
