//! The pipeline: all the way through, from a glTF file to the same file with levels of detail.

mod baked;
mod bars;
mod clock;
pub(crate) mod context;
mod export;
mod extra_layers;
mod gate;
mod import;
mod lattices;
mod layers;
mod level;
mod level_maker;
mod level_task;
mod level_texture;
mod level_whole;
mod likeness;
mod meter;
mod overlap;
mod own_levels;
pub(crate) mod params;
mod preview;
mod reduced_level;
mod reduction;
pub(crate) mod report;
mod runner;
pub(crate) mod scene;
mod shapes;
mod source;
pub(crate) mod stage;
pub(crate) mod store;
mod stored_stages;
mod targets;
mod texture_sizes;
mod version;
mod views;

use crate::settings::{BakeSettings, Scope};
use crate::{Context, Error, ProgressSink, Source, StageId};
use import::Imported;
use layers::SourceLayers;
use level_maker::{LevelMaker, Made};
use params::Params;
use report::Report;
use runner::Runner;
use scene::SceneBake;
use source::{PreparedSource, SourceIndex};
use views::Views;

pub use baked::Baked;
pub use bars::{Bars, Miss};
pub use report::{Likeness, WrongMaterial};
pub use stored_stages::{StageObject, stage_objects};
pub use version::{OPT_LEVEL, PIPELINE_VERSION};

/// Bakes levels of detail for one file.
///
/// Equal bytes, settings and [`PIPELINE_VERSION`] give equal results for any number of threads. Work runs on the rayon
/// pool of the caller.
///
/// # Errors
/// See [`Error`]; a source that fails is left as it is.
pub fn bake(source: &Source<'_>, settings: &BakeSettings, context: &Context<'_>) -> Result<Baked, Error> {
    settings.check()?;
    match settings.scope {
        Scope::Scene => bake_whole(source, settings, context),
        Scope::Objects => bake_objects(source, settings, context),
    }
}

/// Bakes each object of a scene, one after another.
fn bake_objects(source: &Source<'_>, settings: &BakeSettings, context: &Context<'_>) -> Result<Baked, Error> {
    let Some(mut scene) = SceneBake::open(source, settings, context)? else {
        return bake_whole(source, settings, context);
    };
    while let Some(object) = scene.next_object(context)? {
        let progress = context.progress.map(|sink| scene.progress(&object, sink));
        let progress = progress.as_ref().map(|progress| progress as &dyn ProgressSink);
        let context = Context { progress, preview: None, ..context.clone() };
        let baked = bake_whole(&object.source(source), &object.settings, &context);
        scene.take(&object, baked.map(|baked| (baked.glb, baked.report)))?;
    }
    scene.finish(context)
}

/// Bakes the default scene as one model.
fn bake_whole(source: &Source<'_>, settings: &BakeSettings, context: &Context<'_>) -> Result<Baked, Error> {
    let (params, run) = (Params::new(settings), Runner::new(source.name, context));
    // Files without triangles, with few triangles or with levels of their own pass through.
    let (model, targets) = match import::import(source, &params, &run)? {
        Imported::ForLevels(model, targets) => (model, targets),
        Imported::PassesThrough(baked) => return Ok(baked),
    };
    let layers = run.time(StageId::Import, || SourceLayers::divide(&model, &[]));
    let index = SourceIndex::new(source, (&model, &layers.solid), &params.views, &run)?;
    let prepared = PreparedSource::new(&index, &params, &run)?;
    let extra = extra_layers::index_layers(source, (&model, &layers), &params, &run)?;
    let mut maker = LevelMaker {
        source: &prepared,
        extra: &extra,
        has_solid: layers.has_solid,
        views: Views::render(&index, &params, &run)?,
        pictures: None,
        content: run.key(|| store::content_key(source, &model)),
        params: &params,
        run: &run,
    };
    let mut made = maker.make(&targets)?;
    let cards = lattices::replace(source, &mut maker, &mut made)?;
    reduction::replace(source, &maker, cards.as_ref(), &mut made)?;
    gate::raise(&params.gate, &mut maker, &mut made)?;
    gate::check(&params.gate, source.name, &made)?;
    let Made { levels, reports, mut notes } = made;
    notes.extend(run.device_failure());
    let glb = export::export(&model, &levels, &params, &run)?;
    run.finish();
    let report = Report::baked(&model, reports, notes, params.maps.morphs, run.seconds());
    Ok(Baked { glb, levels, model: Some(model), report })
}
