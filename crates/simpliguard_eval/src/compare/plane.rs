//! One channel of an image, and filters of it.

/// A rectangle of values, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plane {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

/// The weights of a filter along one axis: an odd number of them, the middle one for the pixel itself.
pub(crate) type Kernel = Vec<f32>;

impl Plane {
    /// A plane of one value.
    pub(crate) fn filled(width: usize, height: usize, value: f32) -> Self {
        Self { width, height, values: vec![value; width * height] }
    }

    /// The plane whose values `value` gives, pixel by pixel.
    pub(crate) fn from_fn(width: usize, height: usize, value: impl Fn(usize) -> f32) -> Self {
        Self { width, height, values: (0..width * height).map(value).collect() }
    }

    /// The product of two planes, pixel by pixel.
    pub(crate) fn times(&self, other: &Self) -> Self {
        Self::from_fn(self.width, self.height, |i| self.values[i] * other.values[i])
    }

    /// The correlation with a separable kernel. The border repeats outwards.
    pub(crate) fn filtered(&self, across: &Kernel, down: &Kernel) -> Self {
        self.filtered_across(across).filtered_down(down)
    }

    fn filtered_across(&self, kernel: &Kernel) -> Self {
        let (radius, mut out) = (kernel.len() / 2, Self::filled(self.width, self.height, 0.0));
        let mut padded = vec![0.0; self.width + 2 * radius];
        for (from, to) in self.rows().zip(out.values.chunks_exact_mut(self.width.max(1))) {
            let (Some(&first), Some(&last)) = (from.first(), from.last()) else { continue };
            padded[..radius].fill(first);
            padded[radius..radius + self.width].copy_from_slice(from);
            padded[radius + self.width..].fill(last);
            for (k, &weight) in kernel.iter().enumerate() {
                add_scaled(to, &padded[k..k + self.width], weight);
            }
        }
        out
    }

    fn filtered_down(&self, kernel: &Kernel) -> Self {
        let (radius, mut out) = (kernel.len() / 2, Self::filled(self.width, self.height, 0.0));
        for (y, to) in out.values.chunks_exact_mut(self.width.max(1)).enumerate() {
            for (k, &weight) in kernel.iter().enumerate() {
                let near = (y + k).saturating_sub(radius).min(self.height - 1) * self.width;
                add_scaled(to, &self.values[near..near + self.width], weight);
            }
        }
        out
    }

    fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks_exact(self.width.max(1))
    }
}

/// Adds the values of one row to another, times a weight.
fn add_scaled(to: &mut [f32], from: &[f32], weight: f32) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
}

/// A Gaussian with this standard deviation in pixels; its weights sum to one.
pub(crate) fn gaussian(radius: usize, deviation: f32) -> Kernel {
    let bell = |k: usize| {
        let x = (k as f32 - radius as f32) / deviation;
        libm::expf(-0.5 * x * x)
    };
    let weights: Kernel = (0..=2 * radius).map(bell).collect();
    let total: f32 = weights.iter().sum();
    weights.iter().map(|weight| weight / total).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_keep_a_flat_plane_and_spread_a_point() {
        let kernel = gaussian(3, 1.0);
        let flat = Plane::filled(5, 4, 0.5).filtered(&kernel, &kernel);
        assert!(flat.values.iter().all(|value| (value - 0.5).abs() < 1e-6));
        let point = Plane::from_fn(9, 9, |i| if i == 40 { 1.0 } else { 0.0 }).filtered(&kernel, &vec![1.0]);
        assert_eq!(point.values[36..45], [[0.0].as_slice(), &kernel, &[0.0]].concat());
        assert_eq!(point.values[27..36], [0.0; 9]);
    }

    #[test]
    fn the_border_repeats_outwards() {
        let ramp = Plane::from_fn(4, 1, |i| i as f32).filtered(&vec![1.0, 0.0, 0.0], &vec![0.0, 0.0, 1.0]);
        assert_eq!(ramp.values, [0.0, 0.0, 1.0, 2.0]);
    }
}
