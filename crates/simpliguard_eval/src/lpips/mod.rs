//! LPIPS (Zhang et al. 2018): distance of two images by the features of a network that was trained to recognise things.
//!
//! This is version 0.1 with SqueezeNet. The trained weights are not part of this crate: a user gives the file. The features
//! of both images are normalised at each pixel. Their squared differences are weighted by channel, and averaged over the
//! pixels of each of seven maps.

mod convolution;
mod squeezenet;
mod weights;

use std::path::Path;

use image::{Rgba, RgbaImage};
use simpliguard::geometry::Random;

use self::convolution::FeatureMap;
use self::squeezenet::{CHANNELS, SqueezeNet};
use self::weights::Tensors;

pub use self::weights::LpipsError;

/// Mean and deviation of the channels that the network was trained with, of colours from -1 to 1.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Keeps the length of a pixel's features above zero.
const EPSILON: f32 = 1e-10;
/// Seed of the image of noise.
const NOISE_SEED: u64 = 0;

/// The network and its weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Lpips {
    network: SqueezeNet,
    /// Weight of each channel of the seven maps.
    heads: Vec<Vec<f32>>,
}

/// The features of one image, normalised.
pub(crate) struct Features(Vec<FeatureMap>);

impl Lpips {
    /// Reads the weights from a file: the state of the Python module `lpips.LPIPS(net="squeeze")` as safetensors.
    ///
    /// # Errors
    /// If the file cannot be read, or does not hold these weights.
    pub fn open(path: &Path) -> Result<Self, LpipsError> {
        let error = |problem| LpipsError { file: path.display().to_string(), problem };
        let bytes = std::fs::read(path).map_err(|cause| error(format!("it cannot be read: {cause}")))?;
        Self::read(&bytes).map_err(error)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let tensors = Tensors::read(bytes)?;
        let head = |(i, channels)| tensors.numbers(&format!("lin{i}.model.1.weight"), &[1, channels, 1, 1]);
        let heads = CHANNELS.into_iter().enumerate().map(head).collect::<Result<_, _>>()?;
        Ok(Self { network: SqueezeNet::read(&tensors)?, heads })
    }

    /// The features of an opaque image.
    pub(crate) fn features(&self, image: &RgbaImage) -> Features {
        let mut maps = self.network.features(&scaled(image));
        for map in &mut maps {
            map.values.chunks_exact_mut(map.channels).for_each(normalise);
        }
        Features(maps)
    }

    /// The distance of two images of one size, from their features.
    pub(crate) fn distance(&self, a: &Features, b: &Features) -> f64 {
        let of_map = |((a, b), head): ((&FeatureMap, &FeatureMap), &Vec<f32>)| {
            let pixels = a.values.chunks_exact(a.channels).zip(b.values.chunks_exact(b.channels));
            let sum: f64 = pixels.map(|(a, b)| f64::from(weighted_difference(a, b, head))).sum();
            sum / (a.width * a.height).max(1) as f64
        };
        a.0.iter().zip(&b.0).zip(&self.heads).map(of_map).sum()
    }
}

/// An image in which every channel of every pixel is random.
pub(crate) fn noise(size: u32) -> RgbaImage {
    let mut random = Random::new(NOISE_SEED);
    RgbaImage::from_fn(size, size, |_, _| Rgba(std::array::from_fn(|_| (random.bits() >> 56) as u8)))
}

/// The colours of an image, scaled as those that the network was trained with. Alpha is left out.
fn scaled(image: &RgbaImage) -> FeatureMap {
    let scaled = |Rgba(bytes): &Rgba<u8>| {
        let [r, g, b, _] = bytes.map(|byte| f32::from(byte) / 127.5 - 1.0);
        [(r, 0), (g, 1), (b, 2)].map(|(color, k)| (color - SHIFT[k]) / SCALE[k])
    };
    let values = image.pixels().flat_map(scaled).collect();
    FeatureMap { width: image.width() as usize, height: image.height() as usize, channels: 3, values }
}

/// Scales the features of a pixel to length one.
fn normalise(features: &mut [f32]) {
    let length = features.iter().map(|value| value * value).sum::<f32>().sqrt() + EPSILON;
    features.iter_mut().for_each(|value| *value /= length);
}

fn weighted_difference(a: &[f32], b: &[f32], weights: &[f32]) -> f32 {
    a.iter().zip(b).zip(weights).map(|((a, b), weight)| weight * (a - b) * (a - b)).sum()
}

#[cfg(test)]
pub(crate) mod tests {
    use safetensors::Dtype;
    use safetensors::tensor::{TensorView, serialize};

    use super::*;

    /// Name, shape and numbers of each tensor.
    type Table = Vec<(String, Vec<usize>, Vec<f32>)>;

    /// Weights of the real shapes: small pseudo-random numbers, the same each time.
    fn table() -> Table {
        let mut random = Random::new(7);
        let mut table = Vec::new();
        let mut add = |name: String, shape: Vec<usize>, low: f32| {
            let inputs: usize = shape[1..].iter().product();
            let scale = 2.0 / (inputs as f32).sqrt();
            let numbers = (0..shape.iter().product()).map(|_| (random.unit() + low) * scale).collect();
            table.push((name, shape, numbers));
        };
        let mut layer = |name: &str, [inputs, outputs]: [usize; 2], kernel: usize| {
            add(format!("{name}.weight"), vec![outputs, inputs, kernel, kernel], -0.5);
            add(format!("{name}.bias"), vec![outputs], -0.5);
        };
        layer("net.slice1.0", [3, 64], 3);
        let fires = [(2, 3, 64, 16, 64), (2, 4, 128, 16, 64), (3, 6, 128, 32, 128), (3, 7, 256, 32, 128)];
        let more = [(4, 9, 256, 48, 192), (5, 10, 384, 48, 192), (6, 11, 384, 64, 256), (7, 12, 512, 64, 256)];
        for (slice, index, inputs, narrow, wide) in fires.into_iter().chain(more) {
            let name = format!("net.slice{slice}.{index}");
            layer(&format!("{name}.squeeze"), [inputs, narrow], 1);
            layer(&format!("{name}.expand1x1"), [narrow, wide], 1);
            layer(&format!("{name}.expand3x3"), [narrow, wide], 3);
        }
        for (i, channels) in CHANNELS.into_iter().enumerate() {
            add(format!("lin{i}.model.1.weight"), vec![1, channels, 1, 1], 0.0);
        }
        table
    }

    fn file(table: &Table) -> Vec<u8> {
        let bytes: Vec<Vec<u8>> =
            table.iter().map(|(.., numbers)| numbers.iter().flat_map(|n| n.to_le_bytes()).collect()).collect();
        let views = table.iter().zip(&bytes).map(|((name, shape, _), bytes)| {
            (name, TensorView::new(Dtype::F32, shape.clone(), bytes).expect("a tensor of this shape"))
        });
        serialize(views, None).expect("a file")
    }

    /// A network with weights that are made up.
    pub(crate) fn made_up() -> Lpips {
        Lpips::read(&file(&table())).expect("weights of the right shapes")
    }

    #[test]
    fn an_image_is_at_no_distance_from_itself_and_noise_is_far() {
        let lpips = made_up();
        let (flat, dark) =
            (RgbaImage::from_pixel(64, 64, Rgba([200; 4])), RgbaImage::from_pixel(64, 64, Rgba([190; 4])));
        let [flat, dark, noise] = [&flat, &dark, &noise(64)].map(|image| lpips.features(image));
        assert_eq!(lpips.distance(&flat, &flat), 0.0);
        let (near, far) = (lpips.distance(&flat, &dark), lpips.distance(&flat, &noise));
        assert!(near > 0.0 && far > 4.0 * near, "{near} {far}");
        assert_eq!(far, lpips.distance(&noise, &flat));
    }

    #[test]
    fn the_maps_have_the_sizes_of_the_network() {
        let maps = made_up().features(&noise(64)).0;
        // 64 pixels: 31 after the first layer, then 15, 7 and 3 by pooling that rounds up.
        let sizes: Vec<usize> = maps.iter().map(|map| map.width).collect();
        assert_eq!(sizes, [31, 15, 7, 3, 3, 3, 3]);
        assert!(maps.iter().zip(CHANNELS).all(|(map, channels)| map.channels == channels && map.width == map.height));
        let lengths = maps[6].values.chunks_exact(512).map(|pixel| pixel.iter().map(|v| v * v).sum::<f32>());
        assert!(lengths.into_iter().all(|length| (length - 1.0).abs() < 1e-5));
    }

    #[test]
    fn a_pixel_counts_by_direction_and_weight() {
        let mut a = [3.0, 4.0];
        normalise(&mut a);
        assert_eq!(a, [0.6, 0.8]);
        assert_eq!(weighted_difference(&[1.0, 0.0], &[0.0, 0.5], &[2.0, 4.0]), 3.0);
        let mut nothing = [0.0; 2];
        normalise(&mut nothing);
        assert_eq!(nothing, [0.0; 2]);
    }

    #[test]
    fn colours_are_scaled_as_in_training() {
        let white = scaled(&RgbaImage::from_pixel(1, 1, Rgba([255, 0, 255, 9]))).values;
        let expected = [1.030 / 0.458, -0.912 / 0.448, 1.188 / 0.450];
        assert!(white.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6), "{white:?}");
    }

    #[test]
    fn a_file_of_something_else_is_refused_with_its_cause() {
        let problem = |bytes: &[u8]| Lpips::read(bytes).expect_err("refused");
        assert!(problem(b"{}").contains("no safetensors file"));
        let mut short = table();
        short.retain(|(name, ..)| name != "net.slice3.6.squeeze.bias");
        assert_eq!(problem(&file(&short)), "it has no tensor 'net.slice3.6.squeeze.bias'");
        let mut other = table();
        other[0].1 = vec![64, 3, 9, 1];
        assert_eq!(problem(&file(&other)), "tensor 'net.slice1.0.weight' is F32 [64, 3, 9, 1], not F32 [64, 3, 3, 3]");
        let mut broken = table();
        broken[0].2[5] = f32::NAN;
        assert!(problem(&file(&broken)).contains("no number"));
        let missing = Lpips::open(Path::new("no/such.safetensors")).expect_err("no file").to_string();
        assert!(missing.starts_with("no/such.safetensors: it cannot be read"), "{missing}");
    }
}
