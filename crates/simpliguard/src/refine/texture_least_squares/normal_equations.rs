//! Normal equations of a texture: a nine-point stencil.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::refine::lookup::Lookup;
use crate::refine::low_poly::TexelGrid;

/// Weight of the squared change from the initial texture, in pixels.
const PRIOR: f32 = 0.01;

/// One row of the normal equations, with its right-hand side.
#[derive(Clone, Copy, Default)]
pub(super) struct Row {
    /// Coupling with itself, the texel to the right, below and below right.
    pub(super) a: Vec4,
    /// Right-hand side of the three channels; the fourth slot is the coupling with the texel below left.
    pub(super) b: Vec4,
}

impl Row {
    fn add(&mut self, a: Vec4, b: Vec4) {
        self.a += a;
        self.b += b;
    }
}

/// The symmetric system `A x = b` of a texture, one row a texel. The channels share the matrix.
pub(super) struct NormalEquations {
    /// Side of the texture in texels.
    pub(super) size: usize,
    pub(super) rows: Vec<Row>,
}

impl NormalEquations {
    /// Without any pixel.
    pub(super) fn new(size: usize) -> Self {
        Self { size, rows: vec![Row::default(); size * size] }
    }

    /// Adds a pixel of this colour that shows the texture at `lookup`.
    #[inline]
    pub(super) fn add_pixel(&mut self, lookup: Lookup, color: Vec3, weight: f32) {
        let k = lookup.texel;
        let root = weight.sqrt();
        let ([a, b, c, d], color) = (lookup.weights().map(|w| w * root), (color * root).extend(0.0));
        let (top, bottom) = self.rows.split_at_mut(k + self.size);
        let ([r0, r1], [r2, r3]) = (&mut top[k..k + 2], &mut bottom[..2]) else { return };
        r0.add(Vec4::new(a, b, c, d) * a, color * a);
        r1.add(Vec4::new(b * b, 0.0, b * d, 0.0), (color * b).with_w(b * c));
        r2.add(Vec4::new(c * c, c * d, 0.0, 0.0), color * c);
        r3.add(Vec4::new(d * d, 0.0, 0.0, 0.0), color * d);
    }

    /// Adds the pixels of other equations.
    pub(super) fn add(&mut self, other: Self) {
        self.rows.par_iter_mut().zip(other.rows).with_min_len(16_384).for_each(|(row, other)| {
            row.add(other.a, other.b);
        });
    }

    /// Adds the prior, and `smoothness` times the squared differences between the changes of neighbouring texels from
    /// `initial`.
    pub(super) fn regularise(&mut self, initial: &TexelGrid, smoothness: f32) {
        let TexelGrid { texels, covered, .. } = initial;
        let (size, rows) = (self.size, &mut self.rows);
        for i in 0..rows.len() {
            rows[i].a.x += PRIOR;
            rows[i].b += texels[i].with_w(0.0) * PRIOR;
            if !covered[i] {
                continue;
            }
            for (coupling, j, inside) in [(1, i + 1, i % size + 1 < size), (2, i + size, i + size < rows.len())] {
                if inside && covered[j] {
                    rows[i].a.x += smoothness;
                    rows[j].a.x += smoothness;
                    rows[i].a[coupling] -= smoothness;
                    let step = ((texels[i] - texels[j]) * smoothness).with_w(0.0);
                    rows[i].b += step;
                    rows[j].b -= step;
                }
            }
        }
    }

    /// `out = A x`.
    pub(super) fn multiply(&self, x: &[Vec4], out: &mut [Vec4]) {
        out.par_chunks_mut(self.size).enumerate().for_each(|(y, out)| self.multiply_row(x, y, out));
    }

    /// `out = A x` for one row of the texture.
    fn multiply_row(&self, x: &[Vec4], y: usize, out: &mut [Vec4]) {
        let (size, rows) = (self.size, &self.rows);
        let zero = (Row::default(), Vec4::ZERO);
        for (column, out) in out.iter_mut().enumerate() {
            let i = y * size + column;
            let at = |j: Option<usize>| j.and_then(|j| Some((*rows.get(j)?, x[j]))).unwrap_or(zero);
            let own = rows[i];
            let (left, above) = (at(i.checked_sub(1)), at(i.checked_sub(size)));
            let (above_left, above_right) = (at(i.checked_sub(size + 1)), at(i.checked_sub(size - 1)));
            let below = |step: usize| x.get(i + step).copied().unwrap_or(Vec4::ZERO);
            // Couplings across the texture's border are zero, so wrapped neighbours do no harm.
            *out = x[i] * own.a.x
                + below(1) * own.a.y
                + below(size) * own.a.z
                + below(size + 1) * own.a.w
                + below(size - 1) * own.b.w
                + left.1 * left.0.a.y
                + above.1 * above.0.a.z
                + above_left.1 * above_left.0.a.w
                + above_right.1 * above_right.0.b.w;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

    #[test]
    fn the_matrix_is_symmetric() {
        let size = 4;
        let mut equations = NormalEquations::new(size);
        for i in 0..40 {
            let uv = Vec2::new((i * 13 % 40) as f32 / 10.0, (i * 7 % 40) as f32 / 10.0);
            equations.add_pixel(Lookup::new(uv, size), Vec3::ONE, 1.0);
        }
        let column = |j: usize| {
            let mut x = vec![Vec4::ZERO; 16];
            x[j] = Vec4::ONE;
            let mut out = vec![Vec4::ZERO; 16];
            equations.multiply(&x, &mut out);
            out
        };
        let matrix: Vec<Vec<Vec4>> = (0..16).map(column).collect();
        for (i, column) in matrix.iter().enumerate() {
            for (j, value) in column.iter().enumerate() {
                assert_eq!(*value, matrix[j][i]);
            }
        }
    }
}
