//! Views of the source. Every later stage is compared with them.

use glam::Vec3;
use rayon::prelude::*;

use super::camera::Camera;
use super::image::Image;
use super::pool::Pool;
use super::renderer::Renderer;
use super::shader::Light;
use super::surface_sampler::SurfaceSampler;

/// A camera, and the image of the source from it, unlit unless said otherwise.
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// The pose of the source, as in [`Motions`](crate::animation::Motions); `None` for the rest pose.
    pub pose: Option<usize>,
    /// The image of the source, colours premultiplied by coverage.
    pub image: Image,
}

impl View {
    /// The same view at half the size, each pixel the mean of four; `None` if the size is odd.
    pub fn halved(&self) -> Option<Self> {
        Some(Self { camera: self.camera, pose: self.pose, image: self.image.halved()? })
    }
}

/// The size of images, and the points that each pixel is the mean of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// Side in pixels.
    pub size: usize,
    /// Points along each side of a pixel. A pixel is their mean.
    pub samples: usize,
}

impl Sampling {
    /// Pixels that are means of 2 x 2 points.
    pub fn antialiased(size: usize) -> Self {
        Self { size, samples: 2 }
    }
}

/// The view of the source from every camera.
pub fn take_views(sampler: &SurfaceSampler<'_>, cameras: &[Camera], sampling: Sampling) -> Vec<View> {
    ViewTaker::new(sampler, sampling).take(&sampler.model().surface.positions, cameras, None)
}

/// `view` again, under other light. The source has its vertices at `positions`.
pub(super) fn relit(renderer: &mut Renderer<'_>, view: &View, positions: &[Vec3], light: Light) -> View {
    let [image] = renderer.draw_moved(positions, &view.camera, [light]);
    View { image, ..*view }
}

/// Takes views of one source, with as many renderers as there are threads at it.
pub(super) struct ViewTaker<'a> {
    sampler: &'a SurfaceSampler<'a>,
    sampling: Sampling,
    renderers: Pool<Renderer<'a>>,
}

impl<'a> ViewTaker<'a> {
    pub(super) fn new(sampler: &'a SurfaceSampler<'a>, sampling: Sampling) -> Self {
        Self { sampler, sampling, renderers: Pool::new() }
    }

    /// The view from every camera of the source in a pose, its vertices at `positions`.
    pub(super) fn take(&self, positions: &[Vec3], cameras: &[Camera], pose: Option<usize>) -> Vec<View> {
        let Sampling { size, samples } = self.sampling;
        let view = |camera: &Camera| {
            let draw = |renderer: &mut Renderer<'_>| renderer.draw_moved(positions, camera, [Light::None]);
            let [image] = self.renderers.with(|| Renderer::new(self.sampler, size, samples), draw);
            View { camera: *camera, pose, image }
        };
        cameras.par_iter().map(view).collect()
    }
}
