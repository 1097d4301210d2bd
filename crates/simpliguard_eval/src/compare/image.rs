//! Measures of one image of a source and one of its level.

use glam::Vec3;
use simpliguard::render::{Image, decibels};

use super::plane::{Plane, gaussian};

/// Radius and standard deviation of the Gaussian window of SSIM, in pixels.
const WINDOW: (usize, f32) = (5, 1.5);
/// Pixels around the foreground that the filters of SSIM and FLIP reach.
const MARGIN: usize = 12;
/// Alpha of a pixel that counts to the silhouette.
const COVERED: u8 = 128;

/// Two images on white, and what both of them show. Beyond the crop both are white.
pub(crate) struct Pair {
    /// The crop of each image: its red, green and blue, encoded, 0 to 1.
    pub(crate) planes: [[Plane; 3]; 2],
    /// Pixels of the whole image.
    pub(crate) pixels: usize,
    /// Sum of the squared errors, each a mean over the channels.
    squared_errors: f64,
    /// Pixels that either image touches.
    touched: usize,
    /// Pixels of both silhouettes, and of either.
    silhouettes: [usize; 2],
}

impl Pair {
    /// Lays two images of one size on white.
    pub(crate) fn new(a: &Image, b: &Image) -> Self {
        let (mut touched, mut silhouettes, mut squared_errors) = (0, [0; 2], 0.0);
        for i in 0..a.pixels.len() {
            let alphas = [a.pixels[i][3], b.pixels[i][3]];
            if alphas == [0; 2] {
                continue;
            }
            let covered = alphas.map(|alpha| alpha >= COVERED);
            touched += 1;
            silhouettes[0] += usize::from(covered[0] && covered[1]);
            silhouettes[1] += usize::from(covered[0] || covered[1]);
            squared_errors += f64::from((on_white(a, i) - on_white(b, i)).length_squared()) / 3.0;
        }
        let crop = Crop::around(a, b);
        let planes = [a, b].map(|image| [0, 1, 2].map(|channel| crop.plane(image, channel)));
        Self { planes, pixels: a.pixels.len(), squared_errors, touched, silhouettes }
    }

    /// PSNR in dB over the whole image; 100 for images that are alike.
    pub(crate) fn psnr(&self) -> f64 {
        decibels(self.squared_errors / self.pixels.max(1) as f64)
    }

    /// PSNR in dB over the pixels that either image touches.
    pub(crate) fn psnr_foreground(&self) -> f64 {
        decibels(self.squared_errors / self.touched.max(1) as f64)
    }

    /// Intersection over union of the silhouettes; 1 if both are empty.
    pub(crate) fn silhouette_iou(&self) -> f64 {
        let [both, either] = self.silhouettes;
        if either == 0 { 1.0 } else { both as f64 / either as f64 }
    }

    /// Structural similarity (Wang et al. 2004) with a Gaussian window: mean over all pixels and channels.
    pub(crate) fn ssim(&self) -> f64 {
        let loss = |k: usize| {
            let values = ssim(&self.planes[0][k], &self.planes[1][k]);
            values.iter().map(|&s| 1.0 - f64::from(s)).sum::<f64>()
        };
        1.0 - (loss(0) + loss(1) + loss(2)) / (3 * self.pixels).max(1) as f64
    }
}

/// A rectangle of an image.
struct Crop {
    left: usize,
    bottom: usize,
    width: usize,
    height: usize,
}

impl Crop {
    /// The pixels that either image touches, and those that filters spread them to.
    fn around(a: &Image, b: &Image) -> Self {
        let size = a.size;
        let touched = |i: &usize| a.pixels[*i][3] > 0 || b.pixels[*i][3] > 0;
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for i in (0..size * size).filter(touched) {
            for (axis, at) in [i % size, i / size].into_iter().enumerate() {
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at + 1);
            }
        }
        let [left, bottom] = low.map(|at| at.saturating_sub(MARGIN).min(size));
        let [right, top] = high.map(|at| (at + MARGIN).min(size));
        Self { left, bottom, width: right.saturating_sub(left), height: top.saturating_sub(bottom) }
    }

    fn plane(&self, image: &Image, channel: usize) -> Plane {
        Plane::from_fn(self.width, self.height, |i| {
            let (x, y) = (self.left + i % self.width, self.bottom + i / self.width);
            on_white(image, y * image.size + x)[channel]
        })
    }
}

/// A pixel laid on white, in steps of a byte.
fn on_white(image: &Image, i: usize) -> Vec3 {
    let [red, green, blue, alpha] = image.pixels[i].map(u16::from);
    let byte = |color: u16| f32::from((color + 255 - alpha).min(255));
    Vec3::new(byte(red), byte(green), byte(blue)) / 255.0
}

/// The similarity at each pixel of two planes with values from 0 to 1.
fn ssim(x: &Plane, y: &Plane) -> Vec<f32> {
    const C1: f32 = 0.01 * 0.01;
    const C2: f32 = 0.03 * 0.03;
    let window = gaussian(WINDOW.0, WINDOW.1);
    let mean = |plane: &Plane| plane.filtered(&window, &window).values;
    let (mean_x, mean_y) = (mean(x), mean(y));
    let (xx, yy, xy) = (mean(&x.times(x)), mean(&y.times(y)), mean(&x.times(y)));
    let at = |i: usize| {
        let (mx, my) = (mean_x[i], mean_y[i]);
        let (vx, vy, covariance) = (xx[i] - mx * mx, yy[i] - my * my, xy[i] - mx * my);
        let similar = (2.0 * mx * my + C1) * (2.0 * covariance + C2);
        similar / ((mx * mx + my * my + C1) * (vx + vy + C2))
    };
    (0..mean_x.len()).map(at).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Side of the images of the tests.
    const SIDE: usize = 32;

    /// An opaque grey image.
    pub(crate) fn grey(values: impl Fn(usize) -> u8) -> Image {
        Image { size: SIDE, pixels: (0..SIDE * SIDE).map(|i| [values(i), values(i), values(i), 255]).collect() }
    }

    /// A grey square that covers a quarter, from a corner on.
    fn square(value: u8, shift: usize) -> Image {
        let covers = |i: usize| (shift..shift + 16).contains(&(i % SIDE)) && i / SIDE < 16;
        let pixel = |i: usize| if covers(i) { [value, value, value, 255] } else { [0; 4] };
        Image { size: SIDE, pixels: (0..SIDE * SIDE).map(pixel).collect() }
    }

    #[test]
    fn an_image_is_like_itself() {
        let stripes = grey(|i| (i * 37 % 256) as u8);
        let pair = Pair::new(&stripes, &stripes);
        assert_eq!((pair.psnr(), pair.psnr_foreground(), pair.silhouette_iou()), (100.0, 100.0, 1.0));
        assert!((pair.ssim() - 1.0).abs() < 1e-4, "{}", pair.ssim());
    }

    #[test]
    fn errors_count_by_the_pixels_they_are_spread_over() {
        let pair = Pair::new(&square(204, 0), &square(178, 0));
        let expected = -20.0 * (26.0f64 / 255.0).log10();
        assert!((pair.psnr_foreground() - expected).abs() < 1e-3, "{}", pair.psnr_foreground());
        assert!((pair.psnr() - expected - 10.0 * 4f64.log10()).abs() < 1e-3, "{}", pair.psnr());
    }

    #[test]
    fn silhouettes_overlap_by_a_third_if_one_is_shifted_by_half() {
        assert_eq!(Pair::new(&square(0, 0), &square(0, 8)).silhouette_iou(), 1.0 / 3.0);
        let nothing = Image { size: SIDE, pixels: vec![[0; 4]; SIDE * SIDE] };
        let pair = Pair::new(&nothing, &nothing);
        assert_eq!((pair.silhouette_iou(), pair.psnr(), pair.ssim()), (1.0, 100.0, 1.0));
    }

    #[test]
    fn the_crop_changes_no_similarity() {
        let similarity = |shift: usize| Pair::new(&square(90, shift), &square(30, shift)).ssim();
        let whole = |image: Image| Plane::from_fn(SIDE, SIDE, |i| on_white(&image, i).x);
        let mean = |s: Vec<f32>| s.iter().sum::<f32>() / s.len() as f32;
        let expected = mean(ssim(&whole(square(90, 0)), &whole(square(30, 0))));
        assert!((similarity(0) - f64::from(expected)).abs() < 1e-5, "{} {expected}", similarity(0));
    }

    #[test]
    fn ssim_of_flat_images_compares_their_means() {
        let (x, y) = (0.8f32, 0.4f32);
        let expected = (2.0 * x * y + 1e-4) / (x * x + y * y + 1e-4);
        let found = ssim(&Plane::filled(20, 20, x), &Plane::filled(20, 20, y));
        assert!(found.iter().all(|s| (s - expected).abs() < 1e-3), "{found:?} {expected}");
    }

    #[test]
    fn ssim_of_opposite_patterns_is_negative() {
        let checks = Plane::from_fn(20, 20, |i| ((i % 20 + i / 20) % 2) as f32);
        let opposite = Plane::from_fn(20, 20, |i| 1.0 - checks.values[i]);
        let found = ssim(&checks, &opposite);
        assert!(found.iter().sum::<f32>() / 400.0 < -0.9);
    }
}
