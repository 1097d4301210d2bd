//! Renders the views of the source. Candidates are scored by them; textures and vertices are fitted to them.

use rayon::prelude::*;
use serde::Serialize;

use super::camera::viewpoints;
use super::pool::Pool;
use super::renderer::Renderer;
use super::shader::Light;
use super::surface_sampler::SurfaceSampler;
use super::view::{Sampling, View, ViewTaker, relit};
use crate::Cancellation;
use crate::animation::Poses;
use crate::geometry::BoundingSphere;

/// Number and size of the views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ViewParams {
    /// Views of the rest pose. Half as many are taken in other poses.
    pub count: u32,
    /// Side of each square view, in pixels.
    pub size: u32,
    /// Number of poses that decide on the shape, in addition to the rest pose.
    pub poses: u32,
}

impl ViewParams {
    /// Number of views in other poses that go with `count` views of the rest pose.
    pub(crate) fn posed(count: u32) -> usize {
        count as usize / 2
    }
}

/// Renders views of one source.
#[derive(Clone, Copy)]
pub(crate) struct ViewRenderer<'a> {
    pub(crate) sampler: &'a SurfaceSampler<'a>,
    pub(crate) sphere: BoundingSphere,
    pub(crate) poses: Option<&'a Poses<'a>>,
    pub(crate) params: ViewParams,
    /// Seed of the directions of the views.
    pub(crate) seed: u64,
    pub(crate) cancellation: &'a Cancellation,
}

impl ViewRenderer<'_> {
    /// The views of the rest pose and of the other poses, at twice the size and without antialiasing; fewer if cancelled.
    pub(crate) fn aliased_views(&self) -> Vec<View> {
        self.take(self.params.count, Sampling { size: 2 * self.params.size as usize, samples: 1 }, self.seed)
    }

    /// `views` at half resolution, and `further` views from other directions. Empty if the size is odd.
    pub(crate) fn half_resolution_views(&self, views: &[View], further: u32) -> Vec<View> {
        let halved: Option<Vec<View>> = views.par_iter().map(View::halved).collect();
        let Some(mut half_resolution) = halved else { return Vec::new() };
        let sampling = Sampling::antialiased(self.params.size as usize / 2);
        half_resolution.extend(self.take(further, sampling, self.seed.wrapping_add(2)));
        half_resolution
    }

    /// `views` with light of other colours from each axis; fewer if cancelled.
    pub(crate) fn lit_views(&self, views: &[View]) -> Vec<View> {
        let sampling = Sampling::antialiased(self.params.size as usize);
        let new = || Renderer::new(self.sampler, sampling.size, sampling.samples);
        let renderers = Pool::new();
        let lit = |view: &View| {
            let posed = self.poses.zip(view.pose).map(|(poses, pose)| poses.source_in(pose));
            let positions = posed.as_deref().unwrap_or(&self.sampler.model().surface.positions);
            renderers.with(new, |renderer| relit(renderer, view, positions, Light::Axes))
        };
        views.par_iter().filter(|_| !self.cancellation.is_cancelled()).map(lit).collect()
    }

    /// `count` views of the rest pose, and the views of the other poses that go with them.
    fn take(&self, count: u32, sampling: Sampling, seed: u64) -> Vec<View> {
        let Self { sampler, sphere, poses, cancellation, .. } = self;
        // A few at a time: a cancelled bake ends soon.
        let few = 2 * rayon::current_num_threads();
        let wanted = || !cancellation.is_cancelled();
        let cameras = viewpoints(sphere, count as usize, seed);
        let (taker, at_rest) = (ViewTaker::new(sampler, sampling), &sampler.model().surface.positions);
        let taken = cameras.chunks(few).take_while(|_| wanted()).flat_map(|some| taker.take(at_rest, some, None));
        let mut views: Vec<View> = taken.collect();
        let Some(poses) = poses else { return views };
        let posed = (0..poses.all()).into_par_iter().filter(|_| wanted()).flat_map(|pose| {
            let positions = poses.source_in(pose);
            let all = viewpoints(&BoundingSphere::around(&positions), ViewParams::posed(count), seed.wrapping_add(1));
            let own: Vec<_> = all.into_iter().skip(pose).step_by(poses.all()).collect();
            taker.take(&positions, &own, Some(pose))
        });
        views.par_extend(posed);
        views
    }
}
