//! The texture that fits all views best, for fixed vertices.
//!
//! Least squares over every pixel that lies wholly on the source and on the level, plus `smoothness` times the squared
//! difference of how much neighbouring texels change (the expectation of the paper's `L_tex` under small perturbations, taken
//! of the change: a baked texture holds detail that no view resolves) and a small pull towards the initial texture, which
//! decides what no view sees. Rim pixels stay out: they hold background.
//!
//! Solved by conjugate gradients with the diagonal as preconditioner; the channels share the matrix.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;

use super::LowPoly;
use super::forward::{FrameBuffers, Lookup};
use crate::Cancellation;
use crate::render::raster::pixel_to_ndc;
use crate::render::{EMPTY_PIXEL, Rect, View};

/// Pull towards the initial texture, in pixels.
const PRIOR: f32 = 0.01;
/// Smoothness of the first of two solutions.
const FIRST_SMOOTHNESS: f32 = 2.0;
/// Iterations of the conjugate gradients, and those that begin with a solution of half the size.
const ITERATIONS: usize = 30;
const NESTED_ITERATIONS: usize = 8;
/// Partial sums over the views: fixed, so that the result does not depend on the threads.
const PARTS: usize = 4;

/// One row of the normal equations, with its right-hand side.
#[derive(Clone, Copy, Default)]
struct Row {
    /// Coupling with itself, the texel to the right, below, below right and below left.
    a: [f32; 5],
    b: [f32; 3],
}

/// Replaces the texture of `low` by the one that fits `views` best, starting from the present one. `rects` are the
/// pixels that the source covers in each view.
///
/// With a `trust`, a pixel counts by how well it agrees with a first, smoother solution of half the size (one step of
/// iteratively reweighted least squares, with Cauchy weights of this scale): a view that shows another part of the source
/// than the level does, along its inner outlines, leaves no specks. What the first solution changes is where the one at full
/// size begins (nested iteration).
pub fn solve_texture(
    low: &mut LowPoly,
    views: &[&View],
    rects: &[Rect],
    smoothness: f32,
    trust: Option<f32>,
    cancellation: &Cancellation,
) {
    let Some(scale) = trust else {
        return solve(low, views, rects, smoothness, None, cancellation);
    };
    let mut half = low.halved();
    let initial = half.texels.clone();
    solve(&mut half, views, rects, smoothness.max(FIRST_SMOOTHNESS), None, cancellation);
    let change = half.texels.iter().zip(initial).map(|(after, before)| *after - before).collect();
    let first = First { texels: half.texels, change, size: half.size, scale };
    solve(low, views, rects, smoothness, Some(&first), cancellation);
}

fn solve(
    low: &mut LowPoly,
    views: &[&View],
    rects: &[Rect],
    smoothness: f32,
    first: Option<&First>,
    cancellation: &Cancellation,
) {
    let mut rows = assemble(low, views, rects, first, cancellation);
    let seen: Vec<bool> = rows.iter().map(|r| r.a[0] > 0.0).collect();
    regularise(low, &mut rows, smoothness);
    let iterations = first.map_or(ITERATIONS, |first| {
        first.change(&mut low.texels, low.size);
        NESTED_ITERATIONS
    });
    conjugate_gradients(&rows, &mut low.texels, low.size, iterations, cancellation);
    for texel in &mut low.texels {
        *texel = texel.clamp(Vec4::ZERO, Vec4::ONE).with_w(1.0);
    }
    let known: Vec<bool> = low.covered.iter().zip(seen).map(|(covered, seen)| *covered || seen).collect();
    crate::texture::fill(&mut low.texels, &known, low.size);
}

/// A solution of half the side.
struct First {
    texels: Vec<Vec4>,
    /// From the initial texture.
    change: Vec<Vec4>,
    size: usize,
    /// How far off the colour of a pixel may be.
    scale: f32,
}

impl First {
    /// Changes a texture of twice the side alike.
    fn change(&self, texels: &mut [Vec4], size: usize) {
        texels.par_chunks_mut(size).enumerate().for_each(|(y, row)| {
            for (x, texel) in row.iter_mut().enumerate() {
                let uv = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * 0.5;
                *texel += Lookup::new(uv, self.size).sample(&self.change, self.size);
            }
        });
    }

    /// Weight of a pixel of this colour at these texture coordinates, 0 to 1.
    fn trust(&self, uv: Vec2, color: Vec3) -> f32 {
        let shown = Lookup::new(uv * 0.5, self.size).sample(&self.texels, self.size).xyz();
        1.0 / (1.0 + (shown - color).length_squared() / (self.scale * self.scale))
    }
}

fn assemble(
    low: &LowPoly,
    views: &[&View],
    rects: &[Rect],
    first: Option<&First>,
    cancellation: &Cancellation,
) -> Vec<Row> {
    let chunk = views.len().div_ceil(PARTS).max(1);
    let parts: Vec<Vec<Row>> = views
        .par_chunks(chunk)
        .zip(rects.par_chunks(chunk))
        .map(|(views, rects)| {
            let mut rows = vec![Row::default(); low.size * low.size];
            let size = views.first().map_or(0, |v| v.image.size);
            let mut frame = FrameBuffers::new(size);
            let mut rim = vec![false; size * size];
            for (view, rect) in views.iter().zip(rects).take_while(|_| !cancellation.is_cancelled()) {
                add_view(low, view, *rect, first, &mut frame, &mut rim, &mut rows);
            }
            rows
        })
        .collect();
    let mut parts = parts.into_iter();
    let mut rows = parts.next().unwrap_or_else(|| vec![Row::default(); low.size * low.size]);
    for part in parts {
        rows.par_iter_mut().zip(part).with_min_len(16_384).for_each(|(row, other)| {
            row.a.iter_mut().zip(other.a).for_each(|(a, b)| *a += b);
            row.b.iter_mut().zip(other.b).for_each(|(a, b)| *a += b);
        });
    }
    rows
}

fn add_view(
    low: &LowPoly,
    view: &View,
    rect: Rect,
    first: Option<&First>,
    frame: &mut FrameBuffers,
    rim: &mut [bool],
    rows: &mut [Row],
) {
    frame.rasterise(low, &view.camera, view.pose, rect);
    frame.find_blends(low);
    for blend in &frame.blends {
        rim[blend.near as usize] = true;
        rim[blend.far as usize] = true;
    }
    for y in frame.rect.rows() {
        let ndc_y = pixel_to_ndc(y, frame.size);
        for x in frame.rect.columns() {
            let i = y * frame.size + x;
            let id = frame.raster.ids[i];
            if id == EMPTY_PIXEL || rim[i] || view.image.pixels[i][3] != 255 {
                continue;
            }
            let uv = frame.uv_at(low, id as usize, x, ndc_y).0;
            let color = view.image.at(i).xyz();
            let weight = first.map_or(1.0, |first| first.trust(uv, color));
            add_pixel(rows, low.size, Lookup::new(uv, low.size), color, weight);
        }
    }
    for blend in &frame.blends {
        rim[blend.near as usize] = false;
        rim[blend.far as usize] = false;
    }
}

#[inline]
fn add_pixel(rows: &mut [Row], size: usize, lookup: Lookup, color: Vec3, weight: f32) {
    let k = lookup.texel;
    let root = weight.sqrt();
    let ([a, b, c, d], color) = (lookup.weights().map(|w| w * root), color * root);
    let (top, bottom) = rows.split_at_mut(k + size);
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

fn regularise(low: &LowPoly, rows: &mut [Row], smoothness: f32) {
    let size = low.size;
    for i in 0..rows.len() {
        let x = low.texels[i];
        rows[i].a[0] += PRIOR;
        rows[i].b.iter_mut().zip([x.x, x.y, x.z]).for_each(|(b, x)| *b += PRIOR * x);
        if !low.covered[i] {
            continue;
        }
        for (coupling, j, inside) in [(1, i + 1, i % size + 1 < size), (2, i + size, i + size < rows.len())] {
            if inside && low.covered[j] {
                rows[i].a[0] += smoothness;
                rows[j].a[0] += smoothness;
                rows[i].a[coupling] -= smoothness;
                let step = (low.texels[i] - low.texels[j]) * smoothness;
                for (channel, step) in step.xyz().to_array().into_iter().enumerate() {
                    rows[i].b[channel] += step;
                    rows[j].b[channel] -= step;
                }
            }
        }
    }
}

/// `out = A x` for one image row.
fn multiply_row(rows: &[Row], x: &[Vec4], size: usize, y: usize, out: &mut [Vec4]) {
    let zero = (Row::default(), Vec4::ZERO);
    for (column, out) in out.iter_mut().enumerate() {
        let i = y * size + column;
        let at = |j: Option<usize>| j.and_then(|j| Some((*rows.get(j)?, x[j]))).unwrap_or(zero);
        let own = rows[i].a;
        let (left, above) = (at(i.checked_sub(1)), at(i.checked_sub(size)));
        let (above_left, above_right) = (at(i.checked_sub(size + 1)), at(i.checked_sub(size - 1)));
        let below = |step: usize| x.get(i + step).copied().unwrap_or(Vec4::ZERO);
        // Couplings across the image's border are zero, so wrapped neighbours do no harm.
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

fn conjugate_gradients(rows: &[Row], x: &mut [Vec4], size: usize, iterations: usize, cancellation: &Cancellation) {
    /// Residual, relative to the first, at which to stop.
    const TOLERANCE: f32 = 1e-3;
    let multiply = |x: &[Vec4], out: &mut [Vec4]| {
        out.par_chunks_mut(size).enumerate().for_each(|(y, out)| multiply_row(rows, x, size, y, out));
    };
    let dot = |a: &[Vec4], b: &[Vec4]| -> Vec4 {
        let parts: Vec<Vec4> = a
            .par_chunks(8 * size)
            .zip(b.par_chunks(8 * size))
            .map(|(a, b)| a.iter().zip(b).map(|(a, b)| *a * *b).sum())
            .collect();
        parts.into_iter().sum()
    };
    let mut product = vec![Vec4::ZERO; x.len()];
    multiply(x, &mut product);
    let mut residual: Vec<Vec4> =
        rows.iter().zip(&product).map(|(r, p)| Vec3::from(r.b).extend(0.0) - p.with_w(0.0)).collect();
    let mut scaled: Vec<Vec4> = residual.iter().zip(rows).map(|(r, row)| *r / row.a[0]).collect();
    let mut direction = scaled.clone();
    let mut energy = dot(&residual, &scaled);
    let stop = energy.element_sum() * TOLERANCE * TOLERANCE;
    for _ in 0..iterations {
        if energy.element_sum() <= stop || cancellation.is_cancelled() {
            break;
        }
        multiply(&direction, &mut product);
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
                *s = *r / row.a[0];
            });
        let next = dot(&residual, &scaled);
        let turn = Vec4::select(energy.cmpgt(Vec4::splat(1e-30)), next / energy, Vec4::ZERO);
        direction.par_iter_mut().zip(&scaled).with_min_len(8192).for_each(|(d, s)| *d = *s + *d * turn);
        energy = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solution_reproduces_a_texture_from_samples_of_it() {
        let size = 8;
        let truth: Vec<Vec4> =
            (0..64).map(|i| Vec4::new((i * 37 % 64) as f32 / 64.0, (i % 8) as f32 / 8.0, 0.5, 0.0)).collect();
        let mut rows = vec![Row::default(); 64];
        for i in 0..4000 {
            let uv = Vec2::new((i * 7919 % 1000) as f32, (i * 104_729 % 997) as f32) * (8.0 / 1000.0);
            let lookup = Lookup::new(uv, size);
            let k = lookup.texel;
            let [a, b, c, d] = lookup.weights();
            let color = truth[k] * a + truth[k + 1] * b + truth[k + 8] * c + truth[k + 9] * d;
            add_pixel(&mut rows, size, lookup, color.xyz(), 1.0);
        }
        let mut x = vec![Vec4::ZERO; 64];
        conjugate_gradients(&rows, &mut x, size, 200, &Cancellation::default());
        for (x, t) in x.iter().zip(&truth) {
            assert!((*x - *t).length() < 2e-2, "{x} {t}");
        }
    }

    #[test]
    fn what_the_views_do_not_tell_apart_keeps_its_detail() {
        let texels: Vec<Vec4> = (0..64).map(|i| Vec4::splat((i % 3) as f32 * 0.2)).collect();
        let low = LowPoly {
            texels: texels.clone(),
            covered: vec![true; 64],
            ..LowPoly::new(&Default::default(), &Default::default(), false, 8, Vec::new(), Vec::new())
        };
        // One sample in the middle is lighter by a tenth than the texture there.
        let mut rows = vec![Row::default(); 64];
        let (lookup, here) = (Lookup::new(Vec2::splat(4.5), 8), texels[36]);
        (0..1000).for_each(|_| add_pixel(&mut rows, 8, lookup, here.xyz() + 0.1, 1.0));
        regularise(&low, &mut rows, 1.0);
        let mut x = texels.clone();
        conjugate_gradients(&rows, &mut x, 8, 200, &Cancellation::default());
        assert!((x[36].x - here.x - 0.1).abs() < 1e-2, "{}", x[36]);
        // The next one follows it, in its own colour.
        let change = x[37].x - texels[37].x;
        assert!((0.03..0.1).contains(&change), "{change}");
    }

    #[test]
    fn a_pixel_counts_by_how_well_it_agrees() {
        let first = First { texels: vec![Vec4::splat(0.5); 4], change: Vec::new(), size: 2, scale: 0.3 };
        let weight = |error: f32| first.trust(Vec2::splat(1.0), Vec3::new(0.5 + error, 0.5, 0.5));
        assert!(weight(0.0) > 0.999 && (weight(0.3) - 0.5).abs() < 1e-5 && weight(-0.5) < 0.3);
        let lookup = Lookup::new(Vec2::splat(0.5), 2);
        let mut rows = vec![Row::default(); 4];
        for (color, weight) in [(1.0, 0.25), (0.2, 0.75)] {
            add_pixel(&mut rows, 2, lookup, Vec3::splat(color), weight);
        }
        assert!((rows[0].b[0] / rows[0].a[0] - 0.4).abs() < 1e-6);
    }

    #[test]
    fn a_texture_of_twice_the_side_changes_alike() {
        let change = (0..16).map(|i| Vec4::splat((i % 4) as f32)).collect();
        let first = First { texels: Vec::new(), change, size: 4, scale: 0.3 };
        let mut texels = vec![Vec4::splat(10.0); 64];
        first.change(&mut texels, 8);
        let row: Vec<f32> = texels[24..32].iter().map(|t| t.x - 10.0).collect();
        // Texel centres lie a quarter of the larger texels on either side of theirs.
        assert_eq!(row[1..7], [0.25, 0.75, 1.25, 1.75, 2.25, 2.75]);
    }

    #[test]
    fn the_matrix_is_symmetric() {
        let size = 4;
        let mut rows = vec![Row::default(); 16];
        for i in 0..40 {
            let uv = Vec2::new((i * 13 % 40) as f32 / 10.0, (i * 7 % 40) as f32 / 10.0);
            add_pixel(&mut rows, size, Lookup::new(uv, size), Vec3::ONE, 1.0);
        }
        let column = |j: usize| {
            let mut x = vec![Vec4::ZERO; 16];
            x[j] = Vec4::ONE;
            let mut out = vec![Vec4::ZERO; 16];
            out.chunks_mut(size).enumerate().for_each(|(y, out)| multiply_row(&rows, &x, size, y, out));
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
