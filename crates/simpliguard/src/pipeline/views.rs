//! The views of a bake.

use rayon::prelude::*;

use super::params::Params;
use super::runner::Runner;
use super::source::SourceIndex;
use crate::render::{View, ViewRenderer};
use crate::{Error, StageId};

/// Views of the source.
pub(crate) struct Views<'a> {
    renderer: ViewRenderer<'a>,
    /// At full resolution: candidates are scored by them, vertices fitted to them.
    pub(crate) full: Vec<View>,
    /// The same at twice the size, without antialiasing: textures are fitted to them. Empty if none are.
    pub(crate) aliased: Vec<View>,
    /// At half resolution: vertices are moved by them first. `None` while no level is known to need them.
    pub(crate) half_resolution: Option<Vec<View>>,
}

impl<'a> Views<'a> {
    /// Renders the views of full resolution.
    pub(crate) fn render(index: &'a SourceIndex<'a>, params: &Params, run: &Runner<'a>) -> Result<Self, Error> {
        let renderer = index.view_renderer(params.views, run.cancellation());
        let (full, aliased) = run.run(StageId::Views, || {
            let aliased = renderer.aliased_views();
            let full = aliased.par_iter().filter_map(View::halved).collect();
            (full, if params.refine.enabled { aliased } else { Vec::new() })
        })?;
        Ok(Self { renderer, full, aliased, half_resolution: None })
    }

    /// Renders the views of half resolution.
    pub(crate) fn render_half_resolution(&self, params: &Params, run: &Runner<'_>) -> Vec<View> {
        let further = params.refine.half_resolution_views;
        run.time(StageId::Views, || self.renderer.half_resolution_views(&self.full, further))
    }

    /// Renders the views of half resolution if some level needs them and they are still missing.
    pub(crate) fn complete(&mut self, needs_half_resolution: bool, params: &Params, run: &Runner<'_>) {
        if self.half_resolution.is_none() && needs_half_resolution {
            self.half_resolution = Some(self.render_half_resolution(params, run));
        }
    }
}
