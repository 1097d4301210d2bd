//! What a level is made of and from.

use super::extra_layers::{ExtraLayer, ExtraLayers};
use super::likeness::SourcePictures;
use super::params::{LevelParams, Params};
use super::runner::Runner;
use super::shapes::Shapes;
use super::source::PreparedSource;
use super::views::Views;
use crate::simplify::{LayerShape, Shape};

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
