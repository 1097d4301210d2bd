//! How much a level looks like its source, from views that no bake fits.

use glam::{Vec3, Vec4Swizzles};
use rayon::prelude::*;
use simpliguard::data::Model;
use simpliguard::geometry::BoundingSphere;
use simpliguard::render::{Image, Light, Renderer, SurfaceSampler, decibels, viewpoints};

/// Side of one view in pixels.
const SIZE: usize = 512;
/// Bakes take their views by a hash of the source; these are the same for all.
const SEED: u64 = 0x5EED;
/// Radius and standard deviation of the Gaussian window of SSIM, in pixels.
const WINDOW: (usize, f32) = (5, 1.5);

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
    let renderers = || [0, 1].map(|i| Renderer::new(&samplers[i], SIZE, 2));
    let compared: Vec<Similarity> = cameras
        .par_iter()
        .map_init(renderers, |renderers, camera| {
            let [source, level] = renderers.each_mut().map(|renderer| renderer.draw(camera, light));
            compare(&source, &level)
        })
        .collect();
    let mean = |of: fn(&Similarity) -> f64| compared.iter().map(of).sum::<f64>() / compared.len().max(1) as f64;
    Similarity { psnr: mean(|s| s.psnr), psnr_foreground: mean(|s| s.psnr_foreground), ssim: mean(|s| s.ssim) }
}

fn compare(a: &Image, b: &Image) -> Similarity {
    let [x, y] = [a, b].map(on_white);
    let errors: Vec<f64> = x.iter().zip(&y).map(|(x, y)| f64::from((*x - *y).length_squared()) / 3.0).collect();
    let touched = |i: usize| a.pixels[i][3] > 0 || b.pixels[i][3] > 0;
    let foreground = (0..errors.len()).filter(|&i| touched(i)).count();
    let sum: f64 = errors.iter().sum();
    let channels = [0, 1, 2].map(|channel| {
        let plane = |pixels: &[Vec3]| pixels.iter().map(|p| p[channel]).collect::<Vec<f32>>();
        ssim(&plane(&x), &plane(&y), a.size)
    });
    Similarity {
        psnr: decibels(sum / errors.len().max(1) as f64),
        psnr_foreground: decibels(sum / foreground.max(1) as f64),
        ssim: channels.iter().sum::<f64>() / 3.0,
    }
}

fn on_white(image: &Image) -> Vec<Vec3> {
    let white = |i: usize| {
        let pixel = image.at(i);
        pixel.xyz() + (1.0 - pixel.w)
    };
    (0..image.pixels.len()).map(white).collect()
}

/// Mean over the pixels of two planes of `size` x `size` values from 0 to 1.
fn ssim(x: &[f32], y: &[f32], size: usize) -> f64 {
    const C1: f32 = 0.01 * 0.01;
    const C2: f32 = 0.03 * 0.03;
    let product = |a: &[f32], b: &[f32]| blur(&a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>(), size);
    let (mean_x, mean_y) = (blur(x, size), blur(y, size));
    let (xx, yy, xy) = (product(x, x), product(y, y), product(x, y));
    let at = |i: usize| {
        let (mx, my) = (mean_x[i], mean_y[i]);
        let (vx, vy, cov) = (xx[i] - mx * mx, yy[i] - my * my, xy[i] - mx * my);
        let similar = (2.0 * mx * my + C1) * (2.0 * cov + C2);
        f64::from(similar / ((mx * mx + my * my + C1) * (vx + vy + C2)))
    };
    (0..x.len()).map(at).sum::<f64>() / x.len().max(1) as f64
}

/// Gaussian means around each pixel; the border repeats outwards.
fn blur(plane: &[f32], size: usize) -> Vec<f32> {
    let (radius, deviation) = WINDOW;
    let bell = |k: usize| (-((k as f32 - radius as f32) / deviation).powi(2) / 2.0).exp();
    let weights: Vec<f32> = (0..=2 * radius).map(bell).collect();
    let total: f32 = weights.iter().sum();
    let along = |plane: &[f32], index: &dyn Fn(usize, usize) -> usize| -> Vec<f32> {
        let mut out = vec![0.0; plane.len()];
        for line in 0..size {
            for at in 0..size {
                let near = |k: usize| (at + k).saturating_sub(radius).min(size - 1);
                let sum: f32 = weights.iter().enumerate().map(|(k, w)| w * plane[index(line, near(k))]).sum();
                out[index(line, at)] = sum / total;
            }
        }
        out
    };
    along(&along(plane, &|line, at| line * size + at), &|line, at| at * size + line)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: impl Fn(usize) -> u8, alpha: u8) -> Image {
        Image { size: 32, pixels: (0..32 * 32).map(|i| [values(i), values(i), values(i), alpha]).collect() }
    }

    #[test]
    fn a_picture_is_like_itself() {
        let stripes = grey(|i| (i * 37 % 256) as u8, 255);
        let found = compare(&stripes, &stripes);
        assert_eq!((found.psnr, found.psnr_foreground), (100.0, 100.0));
        assert!((found.ssim - 1.0).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn errors_count_by_the_pixels_they_are_spread_over() {
        // A quarter is covered and a tenth of full scale too dark.
        let square = |value: u8| {
            let mut image = grey(|_| 0, 0);
            (0..32 * 32)
                .filter(|i| i % 32 < 16 && i / 32 < 16)
                .for_each(|i| image.pixels[i] = [value, value, value, 255]);
            image
        };
        let found = compare(&square(204), &square(178));
        let expected = -20.0 * (26.0f64 / 255.0).log10();
        assert!((found.psnr_foreground - expected).abs() < 1e-3, "{found:?}");
        assert!((found.psnr - expected - 10.0 * 4f64.log10()).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn ssim_of_flat_pictures_compares_their_means() {
        let (x, y) = (0.8f32, 0.4f32);
        let expected = f64::from((2.0 * x * y + 1e-4) / (x * x + y * y + 1e-4));
        let found = ssim(&[x; 400], &[y; 400], 20);
        assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    }

    #[test]
    fn ssim_of_opposite_patterns_is_negative() {
        let checks: Vec<f32> = (0..400).map(|i| ((i % 20 + i / 20) % 2) as f32).collect();
        let opposite: Vec<f32> = checks.iter().map(|c| 1.0 - c).collect();
        assert!(ssim(&checks, &opposite, 20) < -0.9);
    }
}
