//! Similarity of a level and its source, from views that no bake fits: a quick measure for ablations.
//!
//! [`compare`](crate::compare::compare) takes the views of the benchmark and measures more.

use rayon::prelude::*;
use simpliguard::data::Model;
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Light, Renderer, SurfaceSampler, viewpoints};

use crate::compare::image::Pair;
use crate::compare::views::{SAMPLES, SIZE, mean};

/// Bakes take their views by a hash of the source; these are the same for all.
const SEED: u64 = 0x5EED;

/// Means over views on white.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Similarity {
    /// Peak signal-to-noise ratio in dB; 100 for pictures that are alike.
    pub psnr: f64,
    /// The same over the pixels alone that the source or the level touches.
    pub psnr_foreground: f64,
    /// Structural similarity (Wang et al. 2004) with a Gaussian window, mean over pixels and channels; at most 1.
    pub ssim: f64,
}

/// Compares two models from `views` directions around the first.
pub fn similarity(source: &Model, level: &Model, views: usize, light: Light) -> Similarity {
    let cameras = viewpoints(&BoundingSphere::around(&source.surface.positions), views, SEED);
    let samplers = [source, level].map(SurfaceSampler::new);
    let renderers = || [0, 1].map(|i| Renderer::new(&samplers[i], SIZE, SAMPLES));
    let compared: Vec<[f64; 3]> = cameras
        .par_iter()
        .map_init(renderers, |renderers, camera| {
            let [[source], [level]] = renderers.each_mut().map(|renderer| renderer.draw(camera, [light]));
            let pair = Pair::new(&source, &level);
            [pair.psnr(), pair.psnr_foreground(), pair.ssim()]
        })
        .collect();
    let [psnr, psnr_foreground, ssim] = [0, 1, 2].map(|k| mean(compared.iter().map(|view| view[k])));
    Similarity { psnr, psnr_foreground, ssim }
}
