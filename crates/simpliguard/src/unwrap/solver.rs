//! Direct solution of small sparse Hermitian systems.
//!
//! Complex Cholesky factorisation within the envelope of a reverse Cuthill-McKee ordering (George and Liu 1981,
//! chapters 4 and 5). A chart of `n` vertices has an envelope of about `n^1.5` entries, so the hundreds of charts of
//! a level factor in milliseconds, exactly and in a fixed order of operations. Complex numbers are `DVec2`.

use glam::DVec2;

use crate::geometry::vertex_neighbours;

/// `a * b`.
pub(super) fn mul(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

/// `conj(a) * b`.
pub(super) fn conj_mul(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x + a.y * b.y, a.x * b.y - a.y * b.x)
}

/// Position of each vertex in a reverse Cuthill-McKee ordering of the graph of the triangles' edges, which need not be
/// connected.
pub(super) fn ordering(vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let neighbours = vertex_neighbours(vertices, triangles);
    let mut order = Vec::with_capacity(vertices);
    let mut seen = vec![false; vertices];
    for v in 0..vertices {
        if seen[v] {
            continue;
        }
        // The last vertex of a breadth-first search is a good start: few are farther from the other vertices.
        let start = breadth_first(&neighbours, v as u32, &mut seen.clone()).last().copied().unwrap_or(v as u32);
        order.extend(breadth_first(&neighbours, start, &mut seen));
    }
    let mut position = vec![0; vertices];
    for (i, &v) in order.iter().rev().enumerate() {
        position[v as usize] = i as u32;
    }
    position
}

/// The vertices reached from `start`, breadth first; of the new neighbours of a vertex, those of lower degree first.
fn breadth_first(neighbours: &[Vec<u32>], start: u32, seen: &mut [bool]) -> Vec<u32> {
    let mut order = vec![start];
    seen[start as usize] = true;
    let mut head = 0;
    while head < order.len() {
        let first = order.len();
        for &n in &neighbours[order[head] as usize] {
            if !seen[n as usize] {
                seen[n as usize] = true;
                order.push(n);
            }
        }
        order[first..].sort_by_key(|&n| (neighbours[n as usize].len(), n));
        head += 1;
    }
    order
}

/// The lower triangle of a Hermitian matrix from each row's first entry to its diagonal; after
/// [`Self::factorise`] its Cholesky factor.
pub(super) struct Envelope {
    /// Start of each row in `values`, and the end of the last.
    row: Vec<usize>,
    /// Column of the first stored entry of each row.
    first: Vec<usize>,
    values: Vec<DVec2>,
}

impl Envelope {
    /// A zero matrix; row `i` holds the columns `first[i]..=i`.
    pub(super) fn new(first: Vec<usize>) -> Self {
        let mut row = vec![0];
        let mut end = 0;
        for (i, &f) in first.iter().enumerate() {
            end += i + 1 - f;
            row.push(end);
        }
        Self { row, first, values: vec![DVec2::ZERO; end] }
    }

    /// Adds `value` at row `i`, column `j <= i`.
    pub(super) fn add(&mut self, i: usize, j: usize, value: DVec2) {
        let at = self.row[i] + j - self.first[i];
        self.values[at] += value;
    }

    /// `A = L L^H` in place; `None` if the matrix is not positive definite.
    pub(super) fn factorise(&mut self) -> Option<()> {
        for i in 0..self.first.len() {
            let (before, rest) = self.values.split_at_mut(self.row[i]);
            let (fi, own) = (self.first[i], &mut rest[..=i - self.first[i]]);
            for j in fi..i {
                let fj = self.first[j];
                let from = fi.max(fj);
                let other = &before[self.row[j] + from - fj..self.row[j + 1]];
                let sum = product(&other[..j - from], &own[from - fi..j - fi]);
                own[j - fi] = (own[j - fi] - sum) / other[j - from].x;
            }
            let (diagonal, row) = own.split_last_mut()?;
            let pivot = diagonal.x - row.iter().map(|v| v.length_squared()).sum::<f64>();
            if pivot.is_nan() || pivot <= 1e-14 * diagonal.x {
                return None;
            }
            *diagonal = DVec2::new(pivot.sqrt(), 0.0);
        }
        Some(())
    }

    /// Solves `A x = b` in place, after [`Self::factorise`].
    pub(super) fn solve(&self, b: &mut [DVec2]) {
        let n = self.first.len();
        for i in 0..n {
            let row = &self.values[self.row[i]..self.row[i + 1]];
            let (diagonal, row) = (row[row.len() - 1].x, &row[..row.len() - 1]);
            let sum = row.iter().zip(&b[self.first[i]..i]).fold(DVec2::ZERO, |s, (&l, &x)| s + mul(l, x));
            b[i] = (b[i] - sum) / diagonal;
        }
        for i in (0..n).rev() {
            let row = &self.values[self.row[i]..self.row[i + 1]];
            let x = b[i] / row[row.len() - 1].x;
            b[i] = x;
            for (&l, slot) in row[..row.len() - 1].iter().zip(&mut b[self.first[i]..i]) {
                *slot -= conj_mul(l, x);
            }
        }
    }
}

/// `sum_k conj(a_k) b_k` in four interleaved sums, which hide the latency of the additions.
fn product(a: &[DVec2], b: &[DVec2]) -> DVec2 {
    let mut sums = [DVec2::ZERO; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail = a4.remainder().iter().zip(b4.remainder()).fold(DVec2::ZERO, |s, (&x, &y)| s + conj_mul(x, y));
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += conj_mul(x[k], y[k]);
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + tail
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hermitian_system_of_two_is_solved() {
        // [4, 1 - i; 1 + i, 3] (1, i) = (5 + i, 1 + 4i)
        let mut a = Envelope::new(vec![0, 0]);
        a.add(0, 0, DVec2::new(4.0, 0.0));
        a.add(1, 0, DVec2::new(1.0, 1.0));
        a.add(1, 1, DVec2::new(3.0, 0.0));
        assert!(a.factorise().is_some());
        let mut b = [DVec2::new(5.0, 1.0), DVec2::new(1.0, 4.0)];
        a.solve(&mut b);
        assert!(b[0].distance(DVec2::X) < 1e-12 && b[1].distance(DVec2::Y) < 1e-12, "{b:?}");
    }

    #[test]
    fn a_tridiagonal_system_is_solved_within_its_envelope() {
        let mut a = Envelope::new((0..9usize).map(|i| i.saturating_sub(1)).collect());
        for i in 0..9 {
            a.add(i, i, DVec2::new(2.0, 0.0));
            if i > 0 {
                a.add(i, i - 1, DVec2::new(-1.0, 0.0));
            }
        }
        assert!(a.factorise().is_some());
        let mut b = [DVec2::X; 9];
        a.solve(&mut b);
        for (i, x) in b.iter().enumerate() {
            let exact = 0.5 * ((i + 1) * (9 - i)) as f64;
            assert!((x.x - exact).abs() < 1e-12 && x.y == 0.0);
        }
    }

    #[test]
    fn a_singular_matrix_is_refused() {
        let mut a = Envelope::new(vec![0, 0]);
        for (i, j) in [(0, 0), (1, 0), (1, 1)] {
            a.add(i, j, DVec2::X);
        }
        assert!(a.factorise().is_none());
    }

    #[test]
    fn the_ordering_is_a_permutation_that_narrows_a_strip() {
        let strip: Vec<[u32; 3]> = (0..40).map(|i| [i, (i + 1), (i + 2)]).collect();
        let position = ordering(42, &strip);
        let mut sorted = position.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..42).collect::<Vec<_>>());
        let width = |t: &[u32; 3]| {
            t.map(|v| position[v as usize]).iter().max().copied().unwrap_or(0)
                - t.map(|v| position[v as usize]).iter().min().copied().unwrap_or(0)
        };
        assert!(strip.iter().map(width).max() <= Some(4));
    }
}
