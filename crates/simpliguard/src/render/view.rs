//! What the source looks like from the cameras that every later stage is judged by.

use rayon::prelude::*;

use super::{Camera, Light, Picture, Renderer, SurfaceSampler};

/// A camera and the source's unlit picture from it.
pub struct View {
    /// Where it was taken from.
    pub camera: Camera,
    /// The source, premultiplied over nothing.
    pub picture: Picture,
}

/// Takes the source's picture from every camera, `size` pixels wide, each the mean of 2 x 2 points.
pub fn take_views(sampler: &SurfaceSampler<'_>, cameras: &[Camera], size: usize) -> Vec<View> {
    cameras
        .par_iter()
        .map_init(
            || Renderer::new(sampler, size, 2),
            |renderer, camera| View { camera: *camera, picture: renderer.draw(camera, Light::None) },
        )
        .collect()
}
