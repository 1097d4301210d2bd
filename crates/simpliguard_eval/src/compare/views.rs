//! The views of a comparison: cameras around the source, and the measures over all of them.

use glam::Vec3;
use image::RgbaImage;
use rayon::prelude::*;
use serde::Serialize;
use simpliguard::data::Model;
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Camera, Image, Light, Renderer, SurfaceSampler};

use super::flip::FlipImage;
use super::image::Pair;
use crate::lpips::{Features, Lpips, noise};

/// Side of a view in pixels. Each pixel is the mean of [`SAMPLES`] x [`SAMPLES`] points.
pub(crate) const SIZE: usize = 512;
/// Points along each side of a pixel.
pub(crate) const SAMPLES: usize = 2;
/// Vertical field of view in degrees.
const FIELD_OF_VIEW: f32 = 40.0;
/// The source's bounding sphere takes up the inverse of this of a view.
const MARGIN: f32 = 1.02;

/// Means over views on white.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ImageMetrics {
    /// Peak signal-to-noise ratio in dB; 100 for images that are alike.
    pub psnr: f64,
    /// The same over the pixels alone that the source or the level touches.
    pub psnr_foreground: f64,
    /// Structural similarity (Wang et al. 2004) with a Gaussian window, mean over pixels and channels; at most 1.
    pub ssim: f64,
    /// The difference that a viewer sees who flips between the images (FLIP, Andersson et al. 2020), mean over pixels:
    /// 0 for images that are alike, at most 1.
    pub flip: f64,
}

/// Means over views on white of what a network sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PerceptualMetrics {
    /// LPIPS (Zhang et al. 2018) with SqueezeNet; 0 for images that are alike.
    pub lpips: f64,
    /// One less LPIPS relative to that of noise (NLPIPS in the paper); 1 for images that are alike.
    pub nlpips: f64,
}

/// Likeness of one level, over views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ViewMetrics {
    pub(crate) unlit: ImageMetrics,
    pub(crate) lit: ImageMetrics,
    pub(crate) perceptual: Option<PerceptualMetrics>,
    pub(crate) silhouette_iou: f64,
}

/// `n` cameras around a model, in evenly spread directions (spherical Fibonacci lattice). They depend on nothing but the
/// model's bounding sphere, so that all levels of all methods are seen alike.
pub fn cameras(sphere: &BoundingSphere, n: usize) -> Vec<Camera> {
    let camera = |i: usize| {
        let i = i as f64 + 0.5;
        let y = 1.0 - 2.0 * i / n as f64;
        let radius = (1.0 - y * y).max(0.0).sqrt();
        let angle = std::f64::consts::PI * (1.0 + 5f64.sqrt()) * i;
        let direction = [radius * libm::cos(angle), y, radius * libm::sin(angle)].map(|c| c as f32);
        Camera::orbit(sphere, Vec3::from(direction).normalize(), FIELD_OF_VIEW.to_radians(), MARGIN)
    };
    (0..n).map(camera).collect()
}

/// Compares levels with their source over views. Each view of the source is drawn once.
pub(crate) fn view_metrics(source: &Model, levels: &[&Model], views: usize, lpips: Option<&Lpips>) -> Vec<ViewMetrics> {
    let cameras = cameras(&BoundingSphere::around(&source.surface.positions), views);
    let samplers: Vec<SurfaceSampler<'_>> =
        std::iter::once(source).chain(levels.iter().copied()).map(SurfaceSampler::new).collect();
    // One renderer at a time: each takes 42 MB, and there may be many levels.
    let draw = |sampler: &SurfaceSampler<'_>, camera: &Camera| {
        Renderer::new(sampler, SIZE, SAMPLES).draw(camera, [Light::None, Light::Head])
    };
    let network = lpips.map(|lpips| (lpips, lpips.features(&noise(SIZE as u32))));
    let view = |camera: &Camera| {
        let (source, levels) = samplers.split_first()?;
        let source = draw(source, camera);
        let seen = network.as_ref().map(|(lpips, noise)| SeenView::new(lpips, noise, &source[0]));
        let compare = |level| {
            let level = draw(level, camera);
            let perceptual = seen.as_ref().map(|seen| seen.compare(&level[0]));
            ViewMetrics { perceptual, ..ViewMetrics::of(&source, &level) }
        };
        Some(levels.iter().map(compare).collect())
    };
    let by_view: Vec<Vec<ViewMetrics>> = cameras.par_iter().filter_map(view).collect();
    (0..levels.len()).map(|level| ViewMetrics::mean(by_view.iter().map(|view| &view[level]))).collect()
}

impl ViewMetrics {
    /// One view of a source and of a level, each without and with light.
    fn of(source: &[Image; 2], level: &[Image; 2]) -> Self {
        let [unlit, lit] = [0, 1].map(|light| Pair::new(&source[light], &level[light]));
        let silhouette_iou = unlit.silhouette_iou();
        Self { unlit: ImageMetrics::of(&unlit), lit: ImageMetrics::of(&lit), perceptual: None, silhouette_iou }
    }

    fn mean<'a>(views: impl Iterator<Item = &'a Self> + Clone) -> Self {
        Self {
            unlit: ImageMetrics::mean(views.clone().map(|view| &view.unlit)),
            lit: ImageMetrics::mean(views.clone().map(|view| &view.lit)),
            perceptual: PerceptualMetrics::mean(views.clone().filter_map(|view| view.perceptual)),
            silhouette_iou: mean(views.map(|view| view.silhouette_iou)),
        }
    }
}

impl ImageMetrics {
    fn of(pair: &Pair) -> Self {
        let [a, b] = pair.planes.each_ref().map(FlipImage::new);
        let flip = a.difference(&b).map(f64::from).sum::<f64>() / pair.pixels.max(1) as f64;
        Self { psnr: pair.psnr(), psnr_foreground: pair.psnr_foreground(), ssim: pair.ssim(), flip }
    }

    /// The mean of each figure; zeros of none.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> Self {
        Self {
            psnr: mean(all.clone().map(|m| m.psnr)),
            psnr_foreground: mean(all.clone().map(|m| m.psnr_foreground)),
            ssim: mean(all.clone().map(|m| m.ssim)),
            flip: mean(all.map(|m| m.flip)),
        }
    }
}

/// A view of the source as a network sees it.
struct SeenView<'a> {
    lpips: &'a Lpips,
    image: RgbaImage,
    features: Features,
    /// LPIPS of noise.
    of_noise: f64,
}

impl<'a> SeenView<'a> {
    fn new(lpips: &'a Lpips, noise: &Features, source: &Image) -> Self {
        let image = source.over(1.0);
        let features = lpips.features(&image);
        let of_noise = lpips.distance(noise, &features);
        Self { lpips, image, features, of_noise }
    }

    fn compare(&self, level: &Image) -> PerceptualMetrics {
        let image = level.over(1.0);
        if image == self.image {
            return PerceptualMetrics { lpips: 0.0, nlpips: 1.0 };
        }
        let lpips = self.lpips.distance(&self.lpips.features(&image), &self.features);
        PerceptualMetrics { lpips, nlpips: 1.0 - lpips / self.of_noise }
    }
}

impl PerceptualMetrics {
    /// The mean of each figure; `None` of none.
    fn mean(all: impl Iterator<Item = Self> + Clone) -> Option<Self> {
        all.clone().next()?;
        Some(Self { lpips: mean(all.clone().map(|m| m.lpips)), nlpips: mean(all.map(|m| m.nlpips)) })
    }
}

/// Zero of no values.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0, 0.0), |(count, sum), value| (count + 1, sum + value));
    if count == 0 { 0.0 } else { sum / f64::from(count) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_those_of_the_benchmark() {
        let sphere = BoundingSphere { centre: Vec3::new(1.0, 2.0, 3.0), radius: 2.0 };
        let all = cameras(&sphere, 80);
        assert_eq!(all.len(), 80);
        // The first and the last position by its formulas, in Python.
        let expected = [(0, [1.340_68, 7.890_00, 2.123_77]), (79, [0.372_55, -3.890_00, 2.299_89])];
        for (i, eye) in expected {
            assert!(all[i].eye.distance(Vec3::from(eye)) < 1e-4, "{i}: {}", all[i].eye);
        }
        let distance = 2.0 * 1.02 / 20f32.to_radians().sin();
        assert!(all.iter().all(|c| (c.eye.distance(sphere.centre) - distance).abs() < 1e-4));
    }
}
