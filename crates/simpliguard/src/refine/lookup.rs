use glam::{Vec2, Vec4};

/// A bilinear texture lookup: its first texel, and the fractions towards the next column and row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lookup {
    pub(super) texel: usize,
    pub(super) fx: f32,
    pub(super) fy: f32,
}

impl Lookup {
    /// At `uv`, in texels, of a texture of `size` x `size` texels.
    #[inline]
    pub(super) fn new(uv: Vec2, size: usize) -> Self {
        let last = size as f32 - 1.001;
        let (x, y) = ((uv.x - 0.5).clamp(0.0, last), (uv.y - 0.5).clamp(0.0, last));
        let (i, j) = (x as usize, y as usize);
        Self { texel: j * size + i, fx: x - i as f32, fy: y - j as f32 }
    }

    /// The texel, the one to its right, the one below and the one below right.
    #[inline]
    pub(super) fn texels(&self, size: usize) -> [usize; 4] {
        let k = self.texel;
        [k, k + 1, k + size, k + size + 1]
    }

    /// Weights of the four texels, in the same order.
    #[inline]
    pub(super) fn weights(&self) -> [f32; 4] {
        let (x, y) = (self.fx, self.fy);
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }

    /// The colour of a texture of `size` x `size` texels there.
    #[inline]
    pub(super) fn sample(&self, texels: &[Vec4], size: usize) -> Vec4 {
        let [a, b, c, d] = self.weights();
        let [t00, t10, t01, t11] = self.texels(size).map(|k| texels[k]);
        t00 * a + t10 * b + t01 * c + t11 * d
    }

    /// The alpha there.
    #[inline]
    pub(super) fn opacity(&self, opacity: &[f32], size: usize) -> f32 {
        let [a, b, c, d] = self.weights();
        let [t00, t10, t01, t11] = self.texels(size).map(|k| opacity[k]);
        t00 * a + t10 * b + t01 * c + t11 * d
    }
}
