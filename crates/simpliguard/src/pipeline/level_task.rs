//! What a level is made of and from.

use super::extra_layers::{ExtraLayer, ExtraLayers};
use super::likeness::SourcePictures;
use super::params::{LevelParams, Params};
use super::runner::Runner;
use super::shapes::Shapes;
use super::source::PreparedSource;
use super::texture_sizes::LevelView;
use super::views::Views;
use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::BoundingSphere;
use crate::simplify::{self, LayerShape, Shape};

/// Everything that the levels of a bake share.
#[derive(Clone, Copy)]
pub(super) struct Levels<'a> {
    pub(super) source: &'a PreparedSource<'a>,
    pub(super) views: &'a Views<'a>,
    pub(super) params: &'a Params,
    pub(super) shapes: LayerShapes<'a>,
    /// Index of the first of the levels among all levels of the bake.
    pub(super) first: usize,
    /// Pictures that the levels are compared with; `None` for a preview.
    pub(super) pictures: Option<&'a SourcePictures<'a>>,
    /// Vertices may lie where an earlier bake with other views has left them: for a preview.
    pub(super) warm_start: bool,
    pub(super) run: &'a Runner<'a>,
}

/// The shapes of all layers of the levels.
#[derive(Clone, Copy)]
pub(super) struct LayerShapes<'a> {
    pub(super) solid: &'a Shapes,
    pub(super) extra: &'a ExtraLayers<'a>,
}

impl LayerShapes<'_> {
    /// What the shapes do not meet or leave out, in words.
    pub(super) fn notes(&self) -> Vec<String> {
        self.solid.unmet.iter().cloned().chain(self.extra.notes()).collect()
    }
}

/// One level to make.
pub(super) struct LevelTask<'a> {
    pub(super) all: Levels<'a>,
    /// Counted from 1.
    pub(super) number: usize,
    pub(super) budget: u32,
    /// Of the solid layer.
    pub(super) shape: &'a Shape,
    /// The shape is not the one with the best score.
    pub(super) is_runner_up: bool,
    pub(super) params: LevelParams,
    pub(super) run: Runner<'a>,
}

impl<'a> LevelTask<'a> {
    /// The layers of the level beside the solid one.
    pub(super) fn extra(&self) -> impl Iterator<Item = (&'a ExtraLayer<'a>, &'a LayerShape)> {
        self.all.shapes.extra.of(self.budget)
    }
}

/// How large the level of an index comes into view, if it is made from a shape of the solid layer and those of the others.
pub(super) fn level_view<'s>(
    index: usize,
    (shape, extra): (&Shape, impl Iterator<Item = &'s LayerShape>),
    diagonal: f32,
) -> LevelView {
    let with = |(area, has_cards): (f32, bool), shape: &LayerShape| {
        (area + shape.mesh.area(), has_cards || shape.cards.is_some())
    };
    let (extra_area, has_cards) = extra.fold((0.0, shape.cards.is_some()), with);
    let area = (shape.mesh.area() + extra_area) / (diagonal * diagonal);
    LevelView::new(index, has_cards, (area, shape.deviation.percentile_95))
}

/// The meshes of layers in one, and the relative texel density of each face. Each has the bounding sphere of its source, and
/// tells if it is double-sided.
pub(super) fn charted<'s>(
    layers: impl Iterator<Item = (&'s TriMesh, &'s BoundingSphere, bool)>,
    cancellation: &Cancellation,
) -> (TriMesh, Vec<f32>) {
    let (mut all, mut densities) = (TriMesh::default(), Vec::new());
    for (mesh, sphere, double_sided) in layers {
        densities.extend(simplify::texel_density(mesh, sphere, double_sided, cancellation));
        all.append(mesh);
    }
    (all, densities)
}

/// The vertices of a level may be moved: its outline is that of its mesh. A level whose texture is cut out stays, too.
pub(super) fn may_move(shape: &Shape, params: &LevelParams) -> bool {
    shape.cards.is_none() && !shape.mesh.triangles.is_empty() && params.refine.moves_vertices()
}
