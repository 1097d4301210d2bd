//! The objects of one bake in the stage store, found without baking.
//!
//! The key of a later object depends on results of earlier stages. It is known where the store holds these.

use super::import::{self, Imported};
use super::layers::SourceLayers;
use super::level::{Choice, is_close};
use super::level_task::{charted, level_view, may_move};
use super::params::Params;
use super::runner::Runner;
use super::shapes::{levels_of, simplify_params};
use super::source::{PreparedSource, SourceIndex};
use super::store::{self, atlas_key, candidate_key, choice_key, form_key, shapes_key, vertices_key};
use super::targets::Targets;
use crate::data::Candidate;
use crate::settings::{BakeSettings, Scope};
use crate::simplify::{Selected, Shape};
use crate::{Context, Error, Key, Source, StageId, StageStore};

const SHAPES: &str = "selected shapes";
/// The objects of a level.
const ATLAS: &str = "atlas";
const VERTICES: &str = "refined vertices";

/// An object that a stage keeps in the store.
#[derive(Clone, Debug, PartialEq)]
pub struct StageObject {
    /// The stage.
    pub stage: StageId,
    /// Number of the level, counted from 1. `None` for all levels.
    pub level: Option<usize>,
    /// The content, in words.
    pub content: String,
    /// The key, or the stage whose result has to be stored before the key is known.
    pub key: Result<Key, StageId>,
    /// The store holds the object.
    pub cached: bool,
}

/// The objects of one bake in the stage store, in the order of the stages. Bakes nothing.
///
/// Empty for a file that gets no levels, and with `scope: Objects`, where each object is a bake of its own. Levels that are
/// made a second time, with cards for lattices or from the other shape, are not among them.
///
/// # Errors
/// Those of the import.
pub fn stage_objects(
    source: &Source<'_>,
    settings: &BakeSettings,
    stages: &dyn StageStore,
) -> Result<Vec<StageObject>, Error> {
    let context = Context { stages: Some(stages), ..Context::default() };
    let (params, run) = (Params::new(settings), Runner::new(source.name, &context));
    let (model, targets) = match (settings.scope, import::import(source, &params, &run)?) {
        (Scope::Scene, Imported::ForLevels(model, targets)) => (model, targets),
        _ => return Ok(Vec::new()),
    };
    let layers = SourceLayers::divide(&model, &[]);
    if !layers.extra.is_empty() {
        // The budgets of the solid layer follow from the collapse of the others, which is not stored.
        let shapes = [(StageId::Reconstruct, "candidates"), (StageId::Simplify, SHAPES)];
        let shapes = shapes.map(|(stage, content)| StageObject::unknown(stage, content, StageId::Simplify));
        return Ok(shapes.into_iter().chain(of_level(None, &params, StageId::Simplify)).collect());
    }
    let index = SourceIndex::new(source, (&model, &layers.solid), &params.views, &run)?;
    let source_key = store::content_key(source, &model);
    let prepared = PreparedSource::new(&index, &params, &run)?;
    Ok(Finder { source: &prepared, params: &params, targets: &targets, run: &run }.find(&source_key))
}

/// What the keys follow from.
struct Finder<'a> {
    source: &'a PreparedSource<'a>,
    params: &'a Params,
    targets: &'a Targets,
    run: &'a Runner<'a>,
}

impl Finder<'_> {
    /// All objects. `content` is the key of the source's files.
    fn find(&self, content: &Key) -> Vec<StageObject> {
        let simplify = simplify_params(self.params, self.targets.budgets());
        let form = form_key(self.source);
        let candidate = |candidate: Candidate| {
            let stage = match candidate {
                Candidate::Reconstruction(_) => StageId::Reconstruct,
                Candidate::Source | Candidate::Cards => StageId::Simplify,
            };
            self.known(stage, format!("candidate: {candidate}"), candidate_key(&form, &simplify, candidate))
        };
        let mut all: Vec<StageObject> = self.params.candidates.all().map(candidate).collect();
        let shapes_key = shapes_key(content, &simplify, self.params);
        all.push(self.known(StageId::Simplify, SHAPES, shapes_key));
        let shapes: Option<Vec<Selected>> = self.run.get(&shapes_key);
        match shapes.filter(|shapes| shapes.len() == simplify.budgets.len()) {
            Some(shapes) => {
                let (levels, _) = levels_of(&shapes, self.targets);
                all.extend((0..levels.len()).flat_map(|i| self.level(&shapes_key, &levels, i)));
            }
            None => all.extend(of_level(None, self.params, StageId::Simplify)),
        }
        all.sort_by_key(|object| (object.stage, object.level));
        all
    }

    /// The objects of the level with index `i`.
    fn level(&self, shapes: &Key, levels: &[(u32, Selected)], i: usize) -> Vec<StageObject> {
        let (budget, selected) = &levels[i];
        let level = Some(i + 1);
        let mut all = Vec::new();
        let mut choices = vec![Choice::Best];
        if is_close(selected) {
            let key = choice_key(shapes, &self.params.draft(), *budget);
            all.push(StageObject { level, ..self.known(StageId::Texture, "choice of the shape", key) });
            let Some(is_runner_up) = self.run.get::<Option<bool>>(&key) else {
                all.extend(of_level(level, self.params, StageId::Texture));
                return all;
            };
            // Where it is open, the level is made from both.
            choices = is_runner_up.map_or(vec![Choice::Best, Choice::RunnerUp], |is| vec![Choice::of(is)]);
        }
        all.extend(choices.into_iter().flat_map(|choice| self.of_shape(shapes, (i, *budget), choice.shape(selected))));
        all
    }

    /// The objects of a level that is made from a shape.
    fn of_shape(
        &self,
        shapes: &Key,
        (i, budget): (usize, u32),
        (shape, is_runner_up): (&Shape, bool),
    ) -> Vec<StageObject> {
        let level = Some(i + 1);
        let view = level_view(i, (shape, std::iter::empty()), self.source.deviation_metric.diagonal());
        let params = self.params.level(budget, view);
        let solid = (&shape.mesh, &self.source.index.sphere, shape.double_sided);
        let (mesh, densities) = charted(std::iter::once(solid), self.run.cancellation());
        let atlas = atlas_key(&mesh, &densities, &params.unwrap);
        let mut all = vec![StageObject { level, ..self.known(StageId::Unwrap, ATLAS, atlas) }];
        if may_move(shape, &params) {
            let vertices = vertices_key(shapes, &params, budget, is_runner_up);
            all.push(StageObject { level, ..self.known(StageId::Refine, VERTICES, vertices) });
        }
        all
    }

    fn known(&self, stage: StageId, content: impl Into<String>, key: Key) -> StageObject {
        let cached = self.run.knows(Some(key));
        StageObject { stage, level: None, content: content.into(), key: Ok(key), cached }
    }
}

/// The objects of a level whose shape is not known before a stage has run.
fn of_level(level: Option<usize>, params: &Params, needed: StageId) -> impl Iterator<Item = StageObject> {
    let vertices = params.refine.moves_vertices().then_some((StageId::Refine, VERTICES));
    let objects = std::iter::once((StageId::Unwrap, ATLAS)).chain(vertices);
    objects.map(move |(stage, content)| StageObject { level, ..StageObject::unknown(stage, content, needed) })
}

impl StageObject {
    fn unknown(stage: StageId, content: &str, needed: StageId) -> Self {
        Self { stage, level: None, content: content.to_owned(), key: Err(needed), cached: false }
    }
}
