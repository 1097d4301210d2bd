//! The difference that a viewer sees who flips between two images: LDR-FLIP (Andersson et al. 2020).
//!
//! Colours are compared after the eye's blur, and differences count more where edges and points differ, too. The viewer
//! sits 0.7 m in front of a screen 0.7 m wide with 3,840 pixels.

use std::f32::consts::PI;
use std::sync::LazyLock;

use glam::{Mat3, Vec3};
use simpliguard::data::srgb_to_linear;

use super::plane::{Kernel, Plane, gaussian};

/// Pixels per degree of the viewer's sight.
const PIXELS_PER_DEGREE: f32 = 3840.0 * PI / 180.0;
/// Largest spread of the eye's contrast sensitivity; it sets the radius of all of its filters.
const WIDEST: f32 = 0.04;
/// Width of the edges and points that the eye looks for, in degrees.
const FEATURE_WIDTH: f32 = 0.082;
/// Exponent of colour differences.
const COLOR_EXPONENT: f32 = 0.7;
/// Colour differences up to this fraction of the largest are spread over [`SMALL_RANGE`] of the scale.
const SMALL: f32 = 0.4;
const SMALL_RANGE: f32 = 0.95;

/// Linear sRGB to XYZ, as in the authors' code; columns.
const RGB_TO_XYZ: Mat3 = Mat3::from_cols_array(&[
    10_135_552.0 / 24_577_794.0,
    2_613_072.0 / 12_288_897.0,
    1_425_312.0 / 73_733_382.0,
    8_788_810.0 / 24_577_794.0,
    8_788_810.0 / 12_288_897.0,
    8_788_810.0 / 73_733_382.0,
    4_435_075.0 / 24_577_794.0,
    887_015.0 / 12_288_897.0,
    70_074_185.0 / 73_733_382.0,
]);

/// Constants that do not depend on the images.
struct Constants {
    xyz_to_rgb: Mat3,
    white: Vec3,
    /// Filters of brightness and red-green, and the two that are summed for blue-yellow, with their fractions.
    brightness: Kernel,
    red_green: Kernel,
    blue_yellow: [(f32, Kernel); 2],
    feature_blur: Kernel,
    edge: Kernel,
    point: Kernel,
    /// Linear light of each encoded byte.
    linear: [f32; 256],
    /// The colour difference of green and blue.
    largest: f32,
}

static CONSTANTS: LazyLock<Constants> = LazyLock::new(|| {
    let sum = |kernel: &Kernel| kernel.iter().sum::<f32>();
    let normalised = |kernel: Kernel| kernel.iter().map(|weight| weight / sum(&kernel)).collect::<Kernel>();
    let terms = [(34.1, 0.04), (13.5, 0.025)].map(|(amount, spread): (f32, f32)| {
        let kernel = sensitivity(spread);
        (amount * (PI / spread).sqrt() * sum(&kernel) * sum(&kernel), kernel)
    });
    let total = terms[0].0 + terms[1].0;
    let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation).ceil() as usize;
    let blur = gaussian(radius, deviation);
    let shaped = |shape: &dyn Fn(f32) -> f32| {
        let weights = blur.iter().enumerate().map(|(k, weight)| shape(k as f32 - radius as f32) * weight);
        balanced(weights.collect())
    };
    let constants = Constants {
        xyz_to_rgb: RGB_TO_XYZ.inverse(),
        white: RGB_TO_XYZ * Vec3::ONE,
        brightness: normalised(sensitivity(0.0047)),
        red_green: normalised(sensitivity(0.0053)),
        blue_yellow: terms.map(|(weight, kernel)| (weight / total, normalised(kernel))),
        edge: shaped(&|x| -x),
        point: shaped(&|x| (x / deviation).powi(2) - 1.0),
        feature_blur: blur,
        linear: std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)),
        largest: 0.0,
    };
    let largest = color_difference(constants.perceived(Vec3::Y), constants.perceived(Vec3::Z));
    Constants { largest, ..constants }
});

/// The eye's blur of one channel, before it is normalised.
fn sensitivity(spread: f32) -> Kernel {
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let weight = |x: i32| {
        let degrees = x as f32 / PIXELS_PER_DEGREE;
        libm::expf(-PI * PI * degrees * degrees / spread)
    };
    (-radius..=radius).map(weight).collect()
}

/// Scales positive weights so that they sum to one, and negative ones so that they sum to minus one.
fn balanced(kernel: Kernel) -> Kernel {
    let sum = |sign: f32| kernel.iter().map(|weight| (weight * sign).max(0.0)).sum::<f32>();
    let (positive, negative) = (sum(1.0), sum(-1.0));
    kernel.iter().map(|weight| weight / if *weight > 0.0 { positive } else { negative }).collect()
}

impl Constants {
    /// The opponent colour of an encoded colour: brightness, red-green, blue-yellow.
    fn opponent(&self, encoded: Vec3) -> Vec3 {
        let linear = encoded.to_array().map(|value| self.linear[(value * 255.0 + 0.5) as usize & 0xFF]);
        let xyz = RGB_TO_XYZ * Vec3::from(linear) / self.white;
        Vec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
    }

    /// The linear colour of an opponent colour, within what a screen can show.
    fn shown(&self, opponent: Vec3) -> Vec3 {
        let y = (opponent.x + 16.0) / 116.0;
        let xyz = Vec3::new(y + opponent.y / 500.0, y, y - opponent.z / 200.0);
        (self.xyz_to_rgb * (xyz * self.white)).clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// CIELAB of a linear colour, its chroma adjusted to the brightness (Hunt effect).
    fn perceived(&self, linear: Vec3) -> Vec3 {
        let [x, y, z] = (RGB_TO_XYZ * linear / self.white).to_array().map(lab_root);
        let brightness = 116.0 * y - 16.0;
        let chroma = 0.01 * brightness;
        Vec3::new(brightness, chroma * 500.0 * (x - y), chroma * 200.0 * (y - z))
    }
}

fn lab_root(t: f32) -> f32 {
    const KNEE: f32 = 6.0 / 29.0;
    if t > KNEE * KNEE * KNEE { libm::cbrtf(t) } else { t / (3.0 * KNEE * KNEE) + 4.0 / 29.0 }
}

/// The HyAB distance of two perceived colours, to its exponent.
fn color_difference(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    if d == Vec3::ZERO {
        return 0.0;
    }
    libm::powf(d.x.abs() + d.y.hypot(d.z), COLOR_EXPONENT)
}

/// An image as the eye sees it.
pub(crate) struct FlipImage {
    colors: Vec<Vec3>,
    edges: Vec<f32>,
    points: Vec<f32>,
}

impl FlipImage {
    /// Looks at an image of three encoded channels.
    pub(crate) fn new([red, green, blue]: &[Plane; 3]) -> Self {
        let constants = &*CONSTANTS;
        let (width, height) = (red.width, red.height);
        let encoded = |i: usize| Vec3::new(red.values[i], green.values[i], blue.values[i]);
        let opponent: Vec<Vec3> = (0..width * height).map(|i| constants.opponent(encoded(i))).collect();
        let plane = |channel: usize| Plane::from_fn(width, height, |i| opponent[i][channel]);
        let blurred = |plane: &Plane, kernel: &Kernel| plane.filtered(kernel, kernel).values;
        let brightness = blurred(&plane(0), &constants.brightness);
        let red_green = blurred(&plane(1), &constants.red_green);
        let [(near, first), (far, second)] = &constants.blue_yellow;
        let blue_yellow = plane(2);
        let (first, second) = (blurred(&blue_yellow, first), blurred(&blue_yellow, second));
        let color = |i: usize| {
            let opponent = Vec3::new(brightness[i], red_green[i], near * first[i] + far * second[i]);
            constants.perceived(constants.shown(opponent))
        };
        let grey = Plane::from_fn(width, height, |i| (opponent[i].x + 16.0) / 116.0);
        Self {
            colors: (0..width * height).map(color).collect(),
            edges: feature(&grey, &constants.edge),
            points: feature(&grey, &constants.point),
        }
    }

    /// The difference at each pixel, 0 to 1. Both images have one size.
    pub(crate) fn difference<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = f32> + 'a {
        (0..self.colors.len()).map(|i| {
            let difference = color_difference(self.colors[i], other.colors[i]);
            if difference == 0.0 {
                return 0.0;
            }
            let color = spread(difference, CONSTANTS.largest);
            let edge = (self.edges[i] - other.edges[i]).abs();
            let point = (self.points[i] - other.points[i]).abs();
            let feature = (edge.max(point) * std::f32::consts::FRAC_1_SQRT_2).sqrt();
            libm::powf(color, 1.0 - feature.min(1.0))
        })
    }
}

/// The strength of a feature in both directions, at each pixel.
fn feature(grey: &Plane, kernel: &Kernel) -> Vec<f32> {
    let blur = &CONSTANTS.feature_blur;
    let across = grey.filtered(kernel, blur).values;
    let down = grey.filtered(blur, kernel).values;
    across.iter().zip(&down).map(|(x, y)| x.hypot(*y)).collect()
}

/// Spreads small differences over most of the scale from 0 to 1.
fn spread(difference: f32, largest: f32) -> f32 {
    let small = SMALL * largest;
    if difference < small {
        SMALL_RANGE * difference / small
    } else {
        SMALL_RANGE + (1.0 - SMALL_RANGE) * (difference - small) / (largest - small)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(color: [f32; 3]) -> [Plane; 3] {
        color.map(|value| Plane::filled(24, 24, value))
    }

    fn mean(a: &[Plane; 3], b: &[Plane; 3]) -> f32 {
        let (a, b) = (FlipImage::new(a), FlipImage::new(b));
        let all: Vec<f32> = a.difference(&b).collect();
        all.iter().sum::<f32>() / all.len() as f32
    }

    #[test]
    fn equal_images_do_not_differ_and_green_and_blue_differ_most() {
        assert_eq!(mean(&flat([0.3, 0.5, 0.9]), &flat([0.3, 0.5, 0.9])), 0.0);
        let largest = mean(&flat([0.0, 1.0, 0.0]), &flat([0.0, 0.0, 1.0]));
        assert!((largest - 1.0).abs() < 1e-3, "{largest}");
    }

    /// The figures are those of the authors' own code, `flip_evaluator` 1.7.
    #[test]
    fn differences_are_those_of_the_reference() {
        let near = |found: f32, expected: f32| assert!((found - expected).abs() < 2e-3, "{found} {expected}");
        near(mean(&flat([1.0; 3]), &flat([0.0; 3])), 0.967_39);
        near(mean(&flat([0.5; 3]), &flat([0.6, 0.5, 0.4])), 0.326_08);
        let is_light = |i: usize| (i % 24 / 3 + i / 24 / 3) % 2 == 1;
        let checks = |light: f32, dark: f32| Plane::from_fn(24, 24, |i| if is_light(i) { light } else { dark });
        let one = [checks(1.0, 0.0), checks(0.5, 0.0), checks(0.0, 1.0)];
        near(mean(&one, &[checks(0.0, 1.0), checks(0.25, 0.0), checks(1.0, 0.0)]), 0.414_66);
        let is_inside = |i: usize| (8..16).contains(&(i % 24)) && (8..16).contains(&(i / 24));
        let square = [0.2, 0.4, 0.1].map(|value| Plane::from_fn(24, 24, |i| if is_inside(i) { value } else { 1.0 }));
        near(mean(&flat([1.0; 3]), &square), 0.227_50);
    }
}
