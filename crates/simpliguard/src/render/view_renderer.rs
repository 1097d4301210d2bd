//! The source's pictures that shapes are judged by, and textures and vertices fitted to.

use rayon::prelude::*;

use crate::Context;
use crate::animation::Poses;
use crate::geometry::BoundingSphere;
use crate::render::{SurfaceSampler, View, take_posed_views, take_views, viewpoints};
use crate::settings::BakeSettings;

/// Half as many views as at rest are taken in other poses, each in a pose of its own if there are so many.
pub(crate) fn posed_views(views: u32) -> usize {
    views as usize / 2
}

/// Whoever takes pictures of the source.
#[derive(Clone, Copy)]
pub(crate) struct ViewRenderer<'a> {
    pub(crate) sampler: &'a SurfaceSampler<'a>,
    pub(crate) frame: BoundingSphere,
    pub(crate) poses: Option<&'a Poses<'a>>,
    pub(crate) seed: u64,
    pub(crate) settings: &'a BakeSettings,
    pub(crate) context: &'a Context<'a>,
}

impl ViewRenderer<'_> {
    /// The source in the rest pose and in its other poses; fewer views if cancelled.
    pub(crate) fn views(&self) -> Vec<View> {
        self.take(self.settings.views, self.settings.view_size as usize, self.seed)
    }

    /// What vertices are moved by at half the size, if that is even: `views`, and others from between them.
    pub(crate) fn halves(&self, views: &[View]) -> Vec<View> {
        let settings = self.settings;
        if !settings.refine || settings.coarse_steps * (settings.refine_steps as f32) < 1.0 {
            return Vec::new();
        }
        let halves: Option<Vec<View>> = views.par_iter().map(View::halved).collect();
        let Some(mut halves) = halves else { return Vec::new() };
        halves.extend(self.take(settings.coarse_views, settings.view_size as usize / 2, self.seed.wrapping_add(2)));
        halves
    }

    /// `count` views of the rest pose, and those of the others that go with them.
    fn take(&self, count: u32, size: usize, seed: u64) -> Vec<View> {
        let Self { sampler, frame, poses, context, .. } = self;
        // A few at a time, so that a bake that nobody wants any more ends soon.
        let few = 2 * rayon::current_num_threads();
        let wanted = || !context.cancellation.is_cancelled();
        let cameras = viewpoints(frame, count as usize, seed);
        let taken = cameras.chunks(few).take_while(|_| wanted()).flat_map(|cameras| take_views(sampler, cameras, size));
        let mut views: Vec<View> = taken.collect();
        let Some(poses) = poses else { return views };
        let posed = (0..poses.all()).into_par_iter().filter(|_| wanted()).flat_map(|pose| {
            let positions = poses.source_in(pose);
            let all = viewpoints(&BoundingSphere::around(&positions), posed_views(count), seed.wrapping_add(1));
            let own: Vec<_> = all.into_iter().skip(pose).step_by(poses.all()).collect();
            take_posed_views(sampler, &positions, pose, &own, size)
        });
        views.par_extend(posed);
        views
    }
}
