//! Sets of texels, stored row by row in 64-bit words.

use glam::DVec2;

/// A grid of bits.
#[derive(Clone)]
pub(super) struct Bitmap {
    pub width: usize,
    pub height: usize,
    /// Words per row.
    words: usize,
    bits: Vec<u64>,
}

impl Bitmap {
    /// A grid without set bits.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let words = width.div_ceil(64);
        Self { width, height, words, bits: vec![0; words * height] }
    }

    /// Sets every cell that a triangle of either orientation touches. The triangle must lie inside the grid.
    pub(super) fn cover(&mut self, t: &[DVec2; 3]) {
        let (low, high) = (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
        // No coordinate is negative, so truncation is the floor.
        let last = (high.y as usize).min(self.height.saturating_sub(1));
        for y in low.y as usize..=last {
            let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
            for k in 0..3 {
                if let Some((a, b)) = within_rows(t[k], t[(k + 1) % 3], y as f64, y as f64 + 1.0) {
                    left = left.min(a.min(b));
                    right = right.max(a.max(b));
                }
            }
            if left <= right {
                let end = (right.min(high.x) as usize + 1).min(self.width);
                self.set(y, left.max(low.x) as usize, end);
            }
        }
    }

    /// Sets the cells `from..to` of row `y`.
    pub(super) fn set(&mut self, y: usize, from: usize, to: usize) {
        for_words(from, to, |word, mask| self.bits[y * self.words + word] |= mask);
    }

    /// The last set cell among `from..to` of row `y`.
    pub(super) fn last_set(&self, y: usize, from: usize, to: usize) -> Option<usize> {
        let row = &self.bits[y * self.words..(y + 1) * self.words];
        let (first, last) = (from / 64, (to - 1) / 64);
        for word in (first..=last).rev() {
            let mut bits = row[word];
            if word == first {
                bits &= u64::MAX << (from % 64);
            }
            if word == last {
                bits &= u64::MAX >> (63 - (to - 1) % 64);
            }
            if bits != 0 {
                return Some(64 * word + 63 - bits.leading_zeros() as usize);
            }
        }
        None
    }

    /// The set cells of each row as runs `(from, to)`.
    pub(super) fn runs(&self) -> Vec<Vec<(u32, u32)>> {
        (0..self.height).map(|y| self.row_runs(y).collect()).collect()
    }

    /// The longest run of clear cells in row `y`.
    pub(super) fn longest_gap(&self, y: usize) -> usize {
        let (mut longest, mut end) = (0, 0);
        for (from, to) in self.row_runs(y) {
            longest = longest.max(from as usize - end);
            end = to as usize;
        }
        longest.max(self.width - end)
    }

    /// The runs of set cells of row `y`; cells beyond the width are clear.
    fn row_runs(&self, y: usize) -> impl Iterator<Item = (u32, u32)> + '_ {
        let row = &self.bits[y * self.words..(y + 1) * self.words];
        // The first cell from `x` on whose bit differs from `flip`.
        let find = move |x: usize, flip: u64| {
            let masked = |word: usize| {
                let bits = row[word] ^ flip;
                if word == x / 64 { bits & (u64::MAX << (x % 64)) } else { bits }
            };
            (x / 64..row.len()).find(|&w| masked(w) != 0).map(|w| 64 * w + masked(w).trailing_zeros() as usize)
        };
        let mut x = 0;
        std::iter::from_fn(move || {
            let from = find(x, 0)?;
            x = find(from, u64::MAX).unwrap_or(64 * row.len());
            Some((from as u32, x as u32))
        })
    }

    /// Appends empty rows up to `height`.
    pub(super) fn grow(&mut self, height: usize) {
        if height > self.height {
            self.bits.resize(self.words * height, 0);
            self.height = height;
        }
    }
}

/// Abscissae of the ends of the piece of segment `ab` between two heights; `None` if there is no such piece.
fn within_rows(a: DVec2, b: DVec2, low: f64, high: f64) -> Option<(f64, f64)> {
    let (a, b) = if a.y <= b.y { (a, b) } else { (b, a) };
    if b.y < low || a.y > high {
        return None;
    }
    let at = |y: f64| if b.y > a.y { a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)).clamp(0.0, 1.0) } else { a.x };
    let upper = if b.y > high { at(high) } else { b.x };
    Some((if a.y < low { at(low) } else { a.x }, upper))
}

/// Calls `each(word, mask)` for every word of a row that holds cells of `from..to`; the mask has those cells.
fn for_words(from: usize, to: usize, mut each: impl FnMut(usize, u64)) {
    if from >= to {
        return;
    }
    let (first, last) = (from / 64, (to - 1) / 64);
    for word in first..=last {
        let low = if word == first { u64::MAX << (from % 64) } else { u64::MAX };
        let high = if word == last { u64::MAX >> (63 - (to - 1) % 64) } else { u64::MAX };
        each(word, low & high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_covers_every_cell_it_touches() {
        let mut map = Bitmap::new(4, 4);
        map.cover(&[DVec2::new(0.5, 0.5), DVec2::new(3.5, 0.5), DVec2::new(0.5, 3.5)]);
        let rows: Vec<Vec<(u32, u32)>> = vec![vec![(0, 4)], vec![(0, 4)], vec![(0, 3)], vec![(0, 2)]];
        assert_eq!(map.runs(), rows);
    }

    #[test]
    fn runs_and_last_set_cross_words() {
        let mut map = Bitmap::new(200, 1);
        map.set(0, 60, 130);
        map.set(0, 190, 200);
        assert_eq!(map.runs(), [vec![(60, 130), (190, 200)]]);
        assert_eq!(map.last_set(0, 0, 60), None);
        assert_eq!(map.last_set(0, 0, 64), Some(63));
        assert_eq!(map.last_set(0, 100, 190), Some(129));
        assert_eq!(map.last_set(0, 130, 190), None);
        assert_eq!(map.last_set(0, 0, 200), Some(199));
        assert_eq!((map.longest_gap(0), Bitmap::new(70, 1).longest_gap(0)), (60, 70));
    }
}
