//! Adam (Kingma and Ba 2015).

/// Decay rates of the first and the second moment from step to step.
const BETA1: f32 = 0.9;
const BETA2: f32 = 0.99;

/// First and second moments of the gradient in each coordinate.
pub(super) struct Adam {
    mean: Vec<f32>,
    square: Vec<f32>,
    /// Powers of the decay rates so far.
    beta1: f32,
    beta2: f32,
}

impl Adam {
    /// For `len` coordinates, before the first step.
    pub(super) fn new(len: usize) -> Self {
        Self { mean: vec![0.0; len], square: vec![0.0; len], beta1: 1.0, beta2: 1.0 }
    }

    /// Moves `x` against `gradient` by about `rate` in each coordinate.
    pub(super) fn step(&mut self, x: &mut [f32], gradient: &[f32], rate: f32) {
        self.beta1 *= BETA1;
        self.beta2 *= BETA2;
        let (unbias1, unbias2) = (1.0 / (1.0 - self.beta1), 1.0 / (1.0 - self.beta2));
        for (((x, &g), mean), square) in x.iter_mut().zip(gradient).zip(&mut self.mean).zip(&mut self.square) {
            *mean = *mean * BETA1 + g * (1.0 - BETA1);
            *square = *square * BETA2 + g * g * (1.0 - BETA2);
            // A coordinate that no view sees has no gradient: the small term keeps it in its place.
            *x -= *mean * (rate * unbias1) / ((*square * unbias2).sqrt() + 1e-12);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_length_of_the_rate() {
        let mut x = [0.0; 3];
        Adam::new(3).step(&mut x, &[5.0, -0.1, 0.0], 0.01);
        let expected = [-0.01, 0.01, 0.0];
        assert!(x.iter().zip(expected).all(|(x, e)| (x - e).abs() < 1e-6), "{x:?}");
    }

    #[test]
    fn a_parabola_is_descended() {
        let mut x = [1.0];
        let mut adam = Adam::new(1);
        for _ in 0..500 {
            let gradient = [2.0 * x[0]];
            adam.step(&mut x, &gradient, 0.02);
        }
        assert!(x[0].abs() < 0.05, "{}", x[0]);
    }
}
