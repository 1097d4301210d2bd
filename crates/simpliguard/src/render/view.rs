//! Views of the source. Every later stage is compared with them.

use glam::Vec3;
use rayon::prelude::*;

use super::camera::Camera;
use super::image::Image;
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
    take(sampler, &sampler.model().surface.positions, cameras, sampling, None)
}

/// `view` again, under other light. The source has its vertices at `positions`.
pub(super) fn relit(renderer: &mut Renderer<'_>, view: &View, positions: &[Vec3], light: Light) -> View {
    let [image] = renderer.draw_moved(positions, &view.camera, [light]);
    View { image, ..*view }
}

/// As [`take_views`], with the source in a pose, its vertices at `positions`.
pub fn take_posed_views(
    sampler: &SurfaceSampler<'_>,
    positions: &[Vec3],
    pose: usize,
    cameras: &[Camera],
    sampling: Sampling,
) -> Vec<View> {
    take(sampler, positions, cameras, sampling, Some(pose))
}

fn take(
    sampler: &SurfaceSampler<'_>,
    positions: &[Vec3],
    cameras: &[Camera],
    Sampling { size, samples }: Sampling,
    pose: Option<usize>,
) -> Vec<View> {
    let view = |renderer: &mut Renderer<'_>, camera: &Camera| {
        let [image] = renderer.draw_moved(positions, camera, [Light::None]);
        View { camera: *camera, pose, image }
    };
    cameras.par_iter().map_init(|| Renderer::new(sampler, size, samples), view).collect()
}
