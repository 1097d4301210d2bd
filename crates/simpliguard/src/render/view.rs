//! What the source looks like from the cameras that every later stage is judged by.

use glam::Vec3;
use rayon::prelude::*;

use super::{Camera, Image, Light, Renderer, SurfaceSampler};

/// A camera and the source's unlit picture from it.
pub struct View {
    /// Where it was taken from.
    pub camera: Camera,
    /// The pose the source was in, as in [`Motions`]; `None` for the rest pose.
    pub pose: Option<usize>,
    /// The source, premultiplied over nothing.
    pub image: Image,
}

impl View {
    /// The same view at half the size, each pixel the mean of four; `None` if the size is odd.
    pub fn halved(&self) -> Option<Self> {
        Some(Self { camera: self.camera, pose: self.pose, image: self.image.halved()? })
    }
}

/// Takes the source's picture from every camera, `size` pixels wide, each the mean of 2 x 2 points.
pub fn take_views(sampler: &SurfaceSampler<'_>, cameras: &[Camera], size: usize) -> Vec<View> {
    take(sampler, &sampler.model().surface.positions, cameras, size, None)
}

/// As [`take_views`], with the source's vertices where `pose` takes them.
pub fn take_posed_views(
    sampler: &SurfaceSampler<'_>,
    positions: &[Vec3],
    pose: usize,
    cameras: &[Camera],
    size: usize,
) -> Vec<View> {
    take(sampler, positions, cameras, size, Some(pose))
}

fn take(
    sampler: &SurfaceSampler<'_>,
    positions: &[Vec3],
    cameras: &[Camera],
    size: usize,
    pose: Option<usize>,
) -> Vec<View> {
    let view = |renderer: &mut Renderer<'_>, camera: &Camera| {
        let image = renderer.draw_moved(positions, camera, Light::None);
        View { camera: *camera, pose, image }
    };
    cameras.par_iter().map_init(|| Renderer::new(sampler, size, 2), view).collect()
}
