//! SqueezeNet 1.1 (Iandola et al. 2016), up to its last fire module.

use super::convolution::{Convolution, FeatureMap, Shape};
use super::weights::Tensors;

/// Channels of the seven maps that LPIPS compares.
pub(super) const CHANNELS: [usize; 7] = [64, 128, 256, 384, 384, 512, 512];

/// Fire modules in their order: slice and layer in the names of their weights, channels of the input, of the squeeze layer,
/// and of either expand layer.
const FIRES: [([usize; 2], [usize; 3]); 8] = [
    ([2, 3], [64, 16, 64]),
    ([2, 4], [128, 16, 64]),
    ([3, 6], [128, 32, 128]),
    ([3, 7], [256, 32, 128]),
    ([4, 9], [256, 48, 192]),
    ([5, 10], [384, 48, 192]),
    ([6, 11], [384, 64, 256]),
    ([7, 12], [512, 64, 256]),
];
/// The modules that a map is pooled before.
const POOLED: [usize; 3] = [0, 2, 4];
/// The modules whose maps are compared.
const COMPARED: [usize; 6] = [1, 3, 4, 5, 6, 7];

/// The convolutional part of the network.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SqueezeNet {
    first: Convolution,
    fires: Vec<Fire>,
}

/// A fire module: a narrow layer, and two wide ones beside each other.
#[derive(Clone, Debug, PartialEq)]
struct Fire {
    squeeze: Convolution,
    expand: [Convolution; 2],
}

impl SqueezeNet {
    /// From the state of `lpips.LPIPS`, whose trunk is divided into slices.
    pub(super) fn read(tensors: &Tensors<'_>) -> Result<Self, String> {
        let shape = Shape { channels: [3, CHANNELS[0]], kernel: 3, stride: 2, padding: 0 };
        let first = tensors.convolution("net.slice1.0", shape)?;
        let fires = FIRES
            .iter()
            .map(|([slice, layer], channels)| Fire::read(tensors, &format!("net.slice{slice}.{layer}"), *channels));
        Ok(Self { first, fires: fires.collect::<Result<_, _>>()? })
    }

    /// The seven maps of an image.
    pub(super) fn features(&self, image: &FeatureMap) -> Vec<FeatureMap> {
        let mut maps = vec![self.first.apply(image)];
        let mut map = maps[0].clone();
        for (i, fire) in self.fires.iter().enumerate() {
            if POOLED.contains(&i) {
                map = map.pooled();
            }
            map = fire.apply(&map);
            if COMPARED.contains(&i) {
                maps.push(map.clone());
            }
        }
        maps
    }
}

impl Fire {
    fn read(tensors: &Tensors<'_>, name: &str, [inputs, narrow, wide]: [usize; 3]) -> Result<Self, String> {
        let layer = |name: String, channels, kernel: usize| {
            tensors.convolution(&name, Shape { channels, kernel, stride: 1, padding: kernel / 2 })
        };
        Ok(Self {
            squeeze: layer(format!("{name}.squeeze"), [inputs, narrow], 1)?,
            expand: [
                layer(format!("{name}.expand1x1"), [narrow, wide], 1)?,
                layer(format!("{name}.expand3x3"), [narrow, wide], 3)?,
            ],
        })
    }

    /// The outputs of both wide layers, side by side.
    fn apply(&self, input: &FeatureMap) -> FeatureMap {
        let narrow = self.squeeze.apply(input);
        let [near, far] = self.expand.each_ref().map(|layer| layer.apply(&narrow));
        let pixels = near.values.chunks_exact(near.channels).zip(far.values.chunks_exact(far.channels));
        let values = pixels.flat_map(|(near, far)| near.iter().chain(far)).copied().collect();
        FeatureMap { channels: near.channels + far.channels, values, ..near }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fire_module_squeezes_and_puts_both_wide_layers_side_by_side() {
        let layer = |channels, kernel: usize, weights: &[f32]| {
            let shape = Shape { channels, kernel, stride: 1, padding: kernel / 2 };
            Convolution::new(shape, weights, &vec![0.0; channels[1]])
        };
        // The narrow layer sums two channels; the wide ones take twice that, and the sum of the neighbours.
        let fire = Fire {
            squeeze: layer([2, 1], 1, &[1.0, 1.0]),
            expand: [layer([1, 1], 1, &[2.0]), layer([1, 1], 3, &[1.0; 9])],
        };
        let image = FeatureMap { width: 2, height: 1, channels: 2, values: vec![1.0, 2.0, -4.0, 5.0] };
        let out = fire.apply(&image);
        assert_eq!((out.width, out.height, out.channels), (2, 1, 2));
        assert_eq!(out.values, [6.0, 4.0, 2.0, 4.0]);
    }
}
