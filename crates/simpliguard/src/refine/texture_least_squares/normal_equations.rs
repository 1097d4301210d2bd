//! Normal equations of a texture: a nine-point stencil.

use glam::{Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use crate::refine::lookup::Lookup;
use crate::refine::low_poly::TexelGrid;

/// Weight of the squared change from the initial texture, in pixels.
const PRIOR: f32 = 0.01;

/// One row of the normal equations, with its right-hand side.
#[derive(Clone, Copy, Default)]
pub(super) struct Row {
    /// Coupling with itself, the texel to the right, below, below right and below left.
    pub(super) a: [f32; 5],
    pub(super) b: [f32; 3],
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
        let ([a, b, c, d], color) = (lookup.weights().map(|w| w * root), color * root);
        let (top, bottom) = self.rows.split_at_mut(k + self.size);
        let ([r0, r1], [r2, r3]) = (&mut top[k..k + 2], &mut bottom[..2]) else { return };
        let terms = [a * a, a * b, a * c, a * d];
        r0.a.iter_mut().zip(terms).for_each(|(r, t)| *r += t);
        r1.a[0] += b * b;
        r1.a[2] += b * d;
        r1.a[4] += b * c;
        r2.a[0] += c * c;
        r2.a[1] += c * d;
        r3.a[0] += d * d;
        for (row, weight) in [(r0, a), (r1, b), (r2, c), (r3, d)] {
            let add = color * weight;
            row.b[0] += add.x;
            row.b[1] += add.y;
            row.b[2] += add.z;
        }
    }

    /// Adds the pixels of other equations.
    pub(super) fn add(&mut self, other: Self) {
        self.rows.par_iter_mut().zip(other.rows).with_min_len(16_384).for_each(|(row, other)| {
            row.a.iter_mut().zip(other.a).for_each(|(a, b)| *a += b);
            row.b.iter_mut().zip(other.b).for_each(|(a, b)| *a += b);
        });
    }

    /// Adds the prior, and `smoothness` times the squared differences between the changes of neighbouring texels from
    /// `initial`.
    pub(super) fn regularise(&mut self, initial: &TexelGrid, smoothness: f32) {
        let TexelGrid { texels, covered, .. } = initial;
        let (size, rows) = (self.size, &mut self.rows);
        for i in 0..rows.len() {
            let x = texels[i];
            rows[i].a[0] += PRIOR;
            rows[i].b.iter_mut().zip([x.x, x.y, x.z]).for_each(|(b, x)| *b += PRIOR * x);
            if !covered[i] {
                continue;
            }
            for (coupling, j, inside) in [(1, i + 1, i % size + 1 < size), (2, i + size, i + size < rows.len())] {
                if inside && covered[j] {
                    rows[i].a[0] += smoothness;
                    rows[j].a[0] += smoothness;
                    rows[i].a[coupling] -= smoothness;
                    let step = (texels[i] - texels[j]) * smoothness;
                    for (channel, step) in step.xyz().to_array().into_iter().enumerate() {
                        rows[i].b[channel] += step;
                        rows[j].b[channel] -= step;
                    }
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
            let own = rows[i].a;
            let (left, above) = (at(i.checked_sub(1)), at(i.checked_sub(size)));
            let (above_left, above_right) = (at(i.checked_sub(size + 1)), at(i.checked_sub(size - 1)));
            let below = |step: usize| x.get(i + step).copied().unwrap_or(Vec4::ZERO);
            // Couplings across the texture's border are zero, so wrapped neighbours do no harm.
            *out = x[i] * own[0]
                + below(1) * own[1]
                + below(size) * own[2]
                + below(size + 1) * own[3]
                + below(size - 1) * own[4]
                + left.1 * left.0.a[1]
                + above.1 * above.0.a[2]
                + above_left.1 * above_left.0.a[3]
                + above_right.1 * above_right.0.a[4];
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
