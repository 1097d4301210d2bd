//! Layers of a convolutional network: convolution with rectification, and pooling.

/// Output channels that are summed side by side.
const LANES: usize = 8;
/// Pixels of a row that share what is read of the weights.
const PIXELS: usize = 4;

/// Features of an image: rows from the top, and the channels of a pixel side by side.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FeatureMap {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) channels: usize,
    pub(super) values: Vec<f32>,
}

impl FeatureMap {
    /// A map of zeros.
    pub(super) fn zeros(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, values: vec![0.0; width * height * channels] }
    }

    /// The map with `border` zeros around it.
    fn padded(&self, border: usize) -> Self {
        let mut out = Self::zeros(self.width + 2 * border, self.height + 2 * border, self.channels);
        let (from, to) = (self.width * self.channels, out.width * self.channels);
        for (y, row) in self.values.chunks_exact(from).enumerate() {
            let start = (y + border) * to + border * self.channels;
            out.values[start..start + from].copy_from_slice(row);
        }
        out
    }

    /// The largest value of each channel in windows of 3 x 3 pixels, two pixels apart. Windows at the right and at the lower
    /// border may reach beyond it.
    pub(super) fn pooled(&self) -> Self {
        let Self { channels, .. } = *self;
        let [width, height] = [self.width, self.height].map(|side| (side.saturating_sub(3)).div_ceil(2) + 1);
        let mut out = Self::zeros(width, height, channels);
        for (i, to) in out.values.chunks_exact_mut(channels).enumerate() {
            to.fill(f32::NEG_INFINITY);
            let (x, y) = (2 * (i % width), 2 * (i / width));
            for row in y..(y + 3).min(self.height) {
                for column in x..(x + 3).min(self.width) {
                    let from = &self.values[(row * self.width + column) * channels..][..channels];
                    to.iter_mut().zip(from).for_each(|(to, from)| *to = to.max(*from));
                }
            }
        }
        out
    }
}

/// A convolution with square kernels, after which negative values are zero.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Convolution {
    shape: Shape,
    /// By block of [`LANES`] outputs, row of the kernel, column of the kernel, input and output. Outputs beyond the last one
    /// have zeros.
    weights: Vec<f32>,
    /// One for each output, and zeros up to the end of the last block.
    bias: Vec<f32>,
}

/// The shape of a convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    /// Channels of the input and of the output.
    pub(super) channels: [usize; 2],
    /// Side of a kernel.
    pub(super) kernel: usize,
    /// Distance of neighbouring kernels.
    pub(super) stride: usize,
    /// Zeros around the input.
    pub(super) padding: usize,
}

impl Convolution {
    /// From weights by output, input, row and column of the kernel, and one bias for each output.
    pub(super) fn new(shape: Shape, weights: &[f32], bias: &[f32]) -> Self {
        let Shape { channels: [inputs, outputs], kernel, .. } = shape;
        let mut blocked = vec![0.0; outputs.next_multiple_of(LANES) * inputs * kernel * kernel];
        for (i, &weight) in weights.iter().enumerate() {
            let (tap, input, output) =
                (i % (kernel * kernel), i / (kernel * kernel) % inputs, i / (kernel * kernel * inputs));
            let line = (output / LANES * kernel * kernel + tap) * inputs + input;
            blocked[line * LANES + output % LANES] = weight;
        }
        let mut bias = bias.to_vec();
        bias.resize(outputs.next_multiple_of(LANES), 0.0);
        Self { shape, weights: blocked, bias }
    }

    /// The rectified features of a map.
    pub(super) fn apply(&self, input: &FeatureMap) -> FeatureMap {
        let padded = if self.shape.padding == 0 { None } else { Some(input.padded(self.shape.padding)) };
        let input = padded.as_ref().unwrap_or(input);
        let Shape { channels: [_, outputs], kernel, stride, .. } = self.shape;
        let side = |side: usize| (side + stride).saturating_sub(kernel) / stride;
        let mut out = FeatureMap::zeros(side(input.width), side(input.height), outputs);
        for (y, to) in out.values.chunks_exact_mut((out.width * outputs).max(1)).enumerate() {
            for block in 0..outputs.div_ceil(LANES) {
                self.block_of_row(input, y * stride, block, to);
            }
        }
        out
    }

    /// One block of outputs along the row of kernels whose first row of the input is `top`.
    fn block_of_row(&self, input: &FeatureMap, top: usize, block: usize, to: &mut [f32]) {
        let Shape { channels: [inputs, outputs], kernel, stride, .. } = self.shape;
        let (width, lanes) = (to.len() / outputs, (outputs - block * LANES).min(LANES));
        let line = kernel * inputs;
        let weights = &self.weights[block * kernel * line * LANES..][..kernel * line * LANES];
        for x in (0..width).step_by(PIXELS) {
            let mut sums = [[0.0; LANES]; PIXELS];
            for (row, weights) in weights.chunks_exact(line * LANES).enumerate() {
                // The last pixels of a row may be summed twice.
                let under: [&[f32]; PIXELS] = std::array::from_fn(|p| {
                    let column = (x + p).min(width - 1) * stride;
                    &input.values[((top + row) * input.width + column) * inputs..][..line]
                });
                add_products(&mut sums, weights, under);
            }
            for (p, sums) in sums.iter().enumerate().take(width - x) {
                let to = &mut to[(x + p) * outputs + block * LANES..][..lanes];
                let biased = sums.iter().zip(&self.bias[block * LANES..]).map(|(sum, bias)| (sum + bias).max(0.0));
                to.iter_mut().zip(biased).for_each(|(to, value)| *to = value);
            }
        }
    }
}

/// Adds to the sums of each pixel what lies under it, times the weights of each output.
#[inline]
fn add_products(sums: &mut [[f32; LANES]; PIXELS], weights: &[f32], under: [&[f32]; PIXELS]) {
    for (i, weights) in weights.as_chunks::<LANES>().0.iter().enumerate() {
        for (sums, under) in sums.iter_mut().zip(under) {
            let value = under[i];
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: usize, height: usize, channels: usize, value: impl Fn(usize) -> f32) -> FeatureMap {
        FeatureMap { width, height, channels, values: (0..width * height * channels).map(value).collect() }
    }

    /// The definition of a convolution, term by term.
    fn by_definition(shape: Shape, weights: &[f32], bias: &[f32], input: &FeatureMap) -> Vec<f32> {
        let Shape { channels: [inputs, outputs], kernel, stride, padding } = shape;
        let side = |side: usize| (side + 2 * padding - kernel) / stride + 1;
        let mut out = Vec::new();
        for (y, x, o) in (0..side(input.height))
            .flat_map(|y| (0..side(input.width)).map(move |x| (y, x)))
            .flat_map(|(y, x)| (0..outputs).map(move |o| (y, x, o)))
        {
            let mut sum = bias[o];
            for (i, (dy, dx)) in
                (0..inputs).flat_map(|i| (0..kernel * kernel).map(move |k| (i, (k / kernel, k % kernel))))
            {
                let (row, column) = ((y * stride + dy).wrapping_sub(padding), (x * stride + dx).wrapping_sub(padding));
                if row < input.height && column < input.width {
                    let weight = weights[((o * inputs + i) * kernel + dy) * kernel + dx];
                    sum += weight * input.values[(row * input.width + column) * inputs + i];
                }
            }
            out.push(sum.max(0.0));
        }
        out
    }

    #[test]
    fn convolutions_are_those_of_the_definition() {
        for (inputs, outputs, kernel, stride, padding) in
            [(3, 9, 3, 2, 0), (2, 16, 3, 1, 1), (5, 3, 1, 1, 0), (1, 8, 3, 1, 1)]
        {
            let shape = Shape { channels: [inputs, outputs], kernel, stride, padding };
            // Whole numbers, whose sums are exact.
            let weights: Vec<f32> =
                (0..outputs * inputs * kernel * kernel).map(|i| (i * 7 % 11) as f32 - 5.0).collect();
            let bias: Vec<f32> = (0..outputs).map(|i| i as f32 - 2.0).collect();
            let input = map(7, 6, inputs, |i| (i * 5 % 13) as f32 - 6.0);
            let out = Convolution::new(shape, &weights, &bias).apply(&input);
            assert_eq!(out.values, by_definition(shape, &weights, &bias, &input), "{shape:?}");
            assert_eq!(out.values.len(), out.width * out.height * outputs);
        }
    }

    #[test]
    fn a_box_kernel_sums_its_neighbours() {
        let shape = Shape { channels: [1, 1], kernel: 3, stride: 1, padding: 1 };
        let out = Convolution::new(shape, &[1.0; 9], &[-20.0]).apply(&map(3, 3, 1, |i| i as f32));
        // Corners have four neighbours with themselves, edges six; sums of at most 20 are rectified.
        assert_eq!(out.values, [0.0, 0.0, 0.0, 1.0, 16.0, 7.0, 0.0, 13.0, 4.0]);
    }

    #[test]
    fn windows_of_the_pooling_reach_beyond_the_border() {
        // As `torch.nn.MaxPool2d(3, 2, ceil_mode=True)`.
        let even = map(6, 4, 1, |i| if i == 23 { 9.0 } else { -(i as f32) }).pooled();
        assert_eq!((even.width, even.height), (3, 2));
        assert_eq!(even.values, [0.0, -2.0, -4.0, -12.0, -14.0, 9.0]);
        let odd = map(5, 5, 2, |i| i as f32).pooled();
        assert_eq!((odd.width, odd.height), (2, 2));
        assert_eq!(odd.values, [24.0, 25.0, 28.0, 29.0, 44.0, 45.0, 48.0, 49.0]);
    }
}
