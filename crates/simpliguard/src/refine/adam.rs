//! Adam (Kingma and Ba 2015) on vertex positions.

use glam::Vec3;

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.99;

/// First and second moments of each coordinate.
pub(super) struct Adam {
    mean: Vec<Vec3>,
    square: Vec<Vec3>,
    /// Powers of the decay rates so far.
    beta1: f32,
    beta2: f32,
}

impl Adam {
    pub(super) fn new(len: usize) -> Self {
        Self { mean: vec![Vec3::ZERO; len], square: vec![Vec3::ZERO; len], beta1: 1.0, beta2: 1.0 }
    }

    /// Moves `x` against `gradient` by about `rate` in each coordinate.
    pub(super) fn step(&mut self, x: &mut [Vec3], gradient: &[Vec3], rate: f32) {
        self.beta1 *= BETA1;
        self.beta2 *= BETA2;
        let (unbias1, unbias2) = (1.0 / (1.0 - self.beta1), 1.0 / (1.0 - self.beta2));
        for (((x, &g), mean), square) in x.iter_mut().zip(gradient).zip(&mut self.mean).zip(&mut self.square) {
            *mean = *mean * BETA1 + g * (1.0 - BETA1);
            *square = *square * BETA2 + g * g * (1.0 - BETA2);
            let root = (*square * unbias2).map(f32::sqrt);
            // Vertices that nothing sees have no gradient: the small term keeps them where they are.
            *x -= *mean * (rate * unbias1) / (root + Vec3::splat(1e-12));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_length_of_the_rate() {
        let mut x = [Vec3::ZERO];
        Adam::new(1).step(&mut x, &[Vec3::new(5.0, -0.1, 0.0)], 0.01);
        assert!((x[0] - Vec3::new(-0.01, 0.01, 0.0)).length() < 1e-6, "{}", x[0]);
    }

    #[test]
    fn a_parabola_is_descended() {
        let mut x = [Vec3::ONE];
        let mut adam = Adam::new(1);
        for _ in 0..500 {
            let gradient = [2.0 * x[0]];
            adam.step(&mut x, &gradient, 0.02);
        }
        assert!(x[0].length() < 0.05, "{}", x[0]);
    }
}
