//! Levels that are shown while better ones are made.

use super::export;
use super::level_task::{LayerShapes, Levels};
use super::params::Params;
use super::runner::Runner;
use super::shapes::is_refined;
use super::source::PreparedSource;
use super::views::Views;
use crate::Error;

/// Shows levels with their initial texture, where their shapes are early and the result will be refined. Their vertices
/// are those of an earlier bake with other views, if the store holds them.
pub(super) fn show(
    source: &PreparedSource<'_>,
    views: &Views<'_>,
    params: &Params,
    shapes: LayerShapes<'_>,
    run: &Runner<'_>,
) -> Result<(), Error> {
    let is_refined = |(budget, _): &(u32, _)| is_refined(shapes.solid.key, params, *budget, run);
    let is_wanted =
        shapes.solid.are_early && params.refine.moves_vertices() && !shapes.solid.levels.iter().all(is_refined);
    let Some(sink) = run.preview().filter(|_| is_wanted) else { return Ok(()) };
    let (quick, silent) = (params.unrefined(), run.silent());
    let levels =
        Levels { source, views, params: &quick, shapes, first: 0, pictures: None, warm_start: true, run: &silent };
    let (levels, _) = levels.make()?;
    sink.show(export::export(source.index.whole, &levels, params, &silent)?);
    Ok(())
}
