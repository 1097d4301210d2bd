//! Conjugate gradients with the diagonal as preconditioner.

use glam::Vec4;
use rayon::prelude::*;

use super::normal_equations::NormalEquations;
use crate::Cancellation;

/// Residual, relative to the initial one, at which the iteration stops.
const TOLERANCE: f32 = 1e-3;

/// Moves `x` towards the solution of `equations`, in at most `iterations` steps. Each channel has its own step lengths.
pub(super) fn conjugate_gradients(
    equations: &NormalEquations,
    x: &mut [Vec4],
    iterations: usize,
    cancellation: &Cancellation,
) {
    let NormalEquations { size, rows } = equations;
    let dot = |a: &[Vec4], b: &[Vec4]| dot(a, b, 8 * size);
    let mut product = vec![Vec4::ZERO; x.len()];
    equations.multiply(x, &mut product);
    let mut residual: Vec<Vec4> = rows.iter().zip(&product).map(|(row, p)| (row.b - *p).with_w(0.0)).collect();
    let mut scaled: Vec<Vec4> = residual.iter().zip(rows).map(|(r, row)| *r / row.a.x).collect();
    let mut direction = scaled.clone();
    let mut energy = dot(&residual, &scaled);
    let stop = energy.element_sum() * TOLERANCE * TOLERANCE;
    for _ in 0..iterations {
        if energy.element_sum() <= stop || cancellation.is_cancelled() {
            break;
        }
        equations.multiply(&direction, &mut product);
        let curvature = dot(&direction, &product);
        let length = Vec4::select(curvature.cmpgt(Vec4::splat(1e-20)), energy / curvature, Vec4::ZERO);
        x.par_iter_mut()
            .zip(&direction)
            .zip(residual.par_iter_mut())
            .zip(&product)
            .zip(scaled.par_iter_mut())
            .zip(rows)
            .with_min_len(8192)
            .for_each(|(((((x, d), r), p), s), row)| {
                *x += *d * length;
                *r -= *p * length;
                *s = *r / row.a.x;
            });
        let next = dot(&residual, &scaled);
        let factor = Vec4::select(energy.cmpgt(Vec4::splat(1e-30)), next / energy, Vec4::ZERO);
        direction.par_iter_mut().zip(&scaled).with_min_len(8192).for_each(|(d, s)| *d = *s + *d * factor);
        energy = next;
    }
}

/// Dot product of each channel, summed in chunks of a fixed length, so that it does not depend on the threads.
fn dot(a: &[Vec4], b: &[Vec4], chunk: usize) -> Vec4 {
    let parts: Vec<Vec4> = a
        .par_chunks(chunk)
        .zip(b.par_chunks(chunk))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| *a * *b).sum())
        .collect();
    parts.into_iter().sum()
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec4Swizzles};

    use super::*;
    use crate::refine::lookup::Lookup;
    use crate::refine::low_poly::TexelGrid;

    #[test]
    fn the_solution_reproduces_a_texture_from_samples_of_it() {
        let size = 8;
        let truth: Vec<Vec4> =
            (0..64).map(|i| Vec4::new((i * 37 % 64) as f32 / 64.0, (i % 8) as f32 / 8.0, 0.5, 0.0)).collect();
        let mut equations = NormalEquations::new(size);
        for i in 0..4000 {
            let uv = Vec2::new((i * 7919 % 1000) as f32, (i * 104_729 % 997) as f32) * (8.0 / 1000.0);
            let lookup = Lookup::new(uv, size);
            equations.add_pixel(lookup, lookup.sample(&truth, size).xyz(), 1.0);
        }
        let mut x = vec![Vec4::ZERO; 64];
        conjugate_gradients(&equations, &mut x, 200, &Cancellation::default());
        for (x, t) in x.iter().zip(&truth) {
            assert!((*x - *t).length() < 2e-2, "{x} {t}");
        }
    }

    #[test]
    fn what_the_views_do_not_tell_apart_keeps_its_detail() {
        let texels: Vec<Vec4> = (0..64).map(|i| Vec4::splat((i % 3) as f32 * 0.2)).collect();
        let texture = TexelGrid { size: 8, texels: texels.clone(), covered: vec![true; 64], opacity: Vec::new() };
        // One sample in the middle is lighter by a tenth than the texture there.
        let mut equations = NormalEquations::new(8);
        let (lookup, here) = (Lookup::new(Vec2::splat(4.5), 8), texels[36]);
        (0..1000).for_each(|_| equations.add_pixel(lookup, here.xyz() + 0.1, 1.0));
        equations.regularise(&texture, 1.0);
        let mut x = texels.clone();
        conjugate_gradients(&equations, &mut x, 200, &Cancellation::default());
        assert!((x[36].x - here.x - 0.1).abs() < 1e-2, "{}", x[36]);
        // The next one follows it, in its own colour.
        let change = x[37].x - texels[37].x;
        assert!((0.03..0.1).contains(&change), "{change}");
    }
}
