//! The shapes of the levels: reconstruct and simplify. The pipeline hands the other stages to `simplify`, and keeps the
//! shapes of each candidate in the store.

use super::extra_layers::ExtraLayers;
use super::params::{LevelParams, Params};
use super::runner::Runner;
use super::source::{PreparedSource, StageTools};
use super::store::{candidate_key, form_key, shapes_key, vertices_key};
use super::targets::Targets;
use super::texture_sizes::LevelView;
use super::views::Views;
use crate::data::{Candidate, Deviation};
use crate::geometry::Topology;
use crate::render::View;
use crate::simplify::{self, Selected, Shape, SimplifyParams};
use crate::{Error, Key, StageId};

/// The shapes of the levels' solid layers.
pub(super) struct Shapes {
    /// Budget of each level, budgets ascending, and shapes of its solid layer.
    pub(super) levels: Vec<(u32, Selected)>,
    /// Notes on targets that no shape meets.
    pub(super) unmet: Vec<String>,
    /// Key of the shapes, if stages are stored.
    pub(super) key: Option<Key>,
    /// The store held the shapes of the first candidate: the shapes are there long before the result.
    pub(super) are_early: bool,
    /// The vertices of some level are to be moved at half resolution.
    pub(super) need_half_resolution: bool,
}

impl Shapes {
    /// The shapes of a source without a solid layer: nothing.
    pub(super) fn empty(source: &PreparedSource<'_>, extra: &ExtraLayers<'_>, targets: &Targets) -> Self {
        let budgets = targets.budgets();
        let deviation = |&budget: &u32| {
            extra
                .of(budget)
                .next()
                .map_or(Deviation::default(), |(_, shape)| source.deviation_metric.measure(&shape.mesh))
        };
        let (chosen, unmet) = targets.choose(&budgets, &budgets.iter().map(deviation).collect::<Vec<_>>());
        let empty = || Selected { best: Shape::empty(), runner_up: None };
        let levels = chosen.iter().map(|&i| (budgets[i], empty())).collect();
        Self { levels, unmet, key: None, are_early: false, need_half_resolution: false }
    }
}

/// Finds a shape for each of the targets. `budgets` are those of the solid layer, one for each budget of the targets.
/// `content` is the key of the source's files, if stages are stored. The views of half resolution are rendered beside,
/// unless the shapes are early: a preview should not wait for them.
pub(super) fn find(
    source: &PreparedSource<'_>,
    views: &mut Views<'_>,
    params: &Params,
    (targets, budgets, content): (&Targets, Vec<u32>, Option<Key>),
    run: &Runner<'_>,
) -> Result<Shapes, Error> {
    let simplify = simplify_params(params, budgets);
    let key = content.map(|content| shapes_key(&content, &simplify, params));
    let form = run.key(|| form_key(source));
    let finder = ShapeFinder { source, views: views.scored(), params: &simplify, run, form };
    let are_early = run.preview().is_some() && finder.knows_first();
    let need_half_resolution = params.refine.has_half_resolution_steps()
        && targets.budgets().iter().any(|&n| LevelParams::is_half_resolution(n) && !is_refined(key, params, n, run));
    // The shapes leave threads idle.
    let (shapes, half_resolution) = rayon::join(
        || run.stored(StageId::Simplify, key, || finder.find()),
        || (need_half_resolution && !are_early).then(|| views.render_half_resolution(params, run)),
    );
    let shapes = shapes?;
    for shape in shapes.iter().flat_map(Selected::shapes) {
        run.validate(StageId::Simplify, || Topology::validate_manifold(&shape.mesh));
    }
    views.half_resolution = half_resolution;
    let (levels, unmet) = levels_of(&shapes, targets);
    Ok(Shapes { levels, unmet, key, are_early, need_half_resolution })
}

/// The parameters of the stage for budgets of the solid layer.
pub(super) fn simplify_params(params: &Params, budgets: Vec<u32>) -> SimplifyParams {
    let Params { candidates, collapse, .. } = *params;
    SimplifyParams { budgets, candidates, collapse }
}

/// The levels that meet the targets, of the shapes for each of their budgets; and notes on targets that none meets.
pub(super) fn levels_of(shapes: &[Selected], targets: &Targets) -> (Vec<(u32, Selected)>, Vec<String>) {
    let budgets = targets.budgets();
    let (chosen, unmet) = targets.choose(&budgets, &shapes.iter().map(|s| s.best.deviation).collect::<Vec<_>>());
    (chosen.iter().map(|&i| (budgets[i], shapes[i].clone())).collect(), unmet)
}

/// The store holds the refined vertices of the level of a budget.
pub(super) fn is_refined(shapes: Option<Key>, params: &Params, budget: u32, run: &Runner<'_>) -> bool {
    // Other sizes of textures follow from shapes that are not known yet.
    let shapes = shapes.filter(|_| params.texture_sizes.is_by_faces());
    run.knows(shapes.map(|shapes| vertices_key(&shapes, &params.level(budget, LevelView::default()), budget, false)))
}

struct ShapeFinder<'a> {
    source: &'a PreparedSource<'a>,
    views: &'a [View],
    params: &'a SimplifyParams,
    run: &'a Runner<'a>,
    /// Key of everything that a candidate reads, if stages are stored.
    form: Option<Key>,
}

impl ShapeFinder<'_> {
    /// The store holds the shapes of the first candidate.
    fn knows_first(&self) -> bool {
        let first = self.params.candidates.first().next();
        self.run.knows(first.and_then(|candidate| self.candidate_key(candidate)))
    }

    /// The best shapes for each budget.
    fn find(&self) -> Result<Vec<Selected>, Error> {
        let Self { source, views, params, run, .. } = *self;
        let tools = StageTools { source, run };
        let inputs = tools.inputs(views);
        let generate = |candidate| {
            run.get_or_put(self.candidate_key(candidate), || Ok(simplify::generate(&inputs, params, candidate)))
        };
        simplify::simplify(&inputs, params, &generate)
    }

    fn candidate_key(&self, candidate: Candidate) -> Option<Key> {
        self.form.map(|form| candidate_key(&form, self.params, candidate))
    }
}
