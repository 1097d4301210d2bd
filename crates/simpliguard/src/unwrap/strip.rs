//! The strip of cells that charts are placed in, open upwards.

use std::collections::BTreeMap;

use super::bitmap::Bitmap;
use super::piece::Stamp;
use super::texel_grid::TexelGrid;

/// Longest side in cells of a small stamp. Its search starts where that of the last stamp of similar size ended.
const SMALL: usize = 48;

/// The cells taken, with a margin of the gutter on each side.
pub(super) struct Strip {
    taken: Bitmap,
    /// Longest free run of each row.
    gap: Vec<usize>,
    /// Height at which the search for a small stamp ended last, by approximate width and height of the stamp. Below it
    /// there is hardly room for the next stamp of that size.
    reached: BTreeMap<(usize, usize), usize>,
    grid: TexelGrid,
}

impl Strip {
    /// A strip without cells taken.
    pub(super) fn new(grid: TexelGrid) -> Self {
        Self { taken: Bitmap::new(grid.side + 2 * grid.gutter, 0), gap: Vec::new(), reached: BTreeMap::new(), grid }
    }

    /// The corner of the lowest, then leftmost free place for a stamp whose top stays below `room`.
    pub(super) fn lowest(&mut self, stamp: &Stamp, room: usize) -> Option<(usize, usize)> {
        let border = self.grid.border;
        let rightmost = self.grid.side.checked_sub(border + stamp.width).filter(|&x| x >= border)?;
        let kind = (stamp.width.div_ceil(4), stamp.height.div_ceil(4));
        let is_small = stamp.width.max(stamp.height) <= SMALL;
        let mut y = if is_small { self.reached.get(&kind).copied().unwrap_or(border) } else { border };
        while y + stamp.height < room {
            self.grow(y + stamp.keep_free.len());
            let has_room = stamp.order.iter().all(|&row| stamp.widest[row] <= self.gap[y + row]);
            let mut x = if has_room { border } else { usize::MAX };
            while x <= rightmost {
                match self.collision(stamp, x, y) {
                    Some(next) => x = next,
                    None => {
                        self.reached.insert(kind, y);
                        return Some((x, y));
                    }
                }
            }
            y += 1;
        }
        None
    }

    /// The next abscissa to try if the stamp collides at `(x, y)`; `None` if it does not collide.
    fn collision(&self, stamp: &Stamp, x: usize, y: usize) -> Option<usize> {
        stamp.order.iter().find_map(|&row| {
            stamp.keep_free[row].iter().find_map(|&(from, to)| {
                let last = self.taken.last_set(y + row, x + from as usize, x + to as usize)?;
                Some(last + 1 - from as usize)
            })
        })
    }

    /// Takes the cells of a stamp whose lower corner is at `corner`.
    pub(super) fn take(&mut self, stamp: &Stamp, corner: (usize, usize)) {
        let gutter = self.grid.gutter;
        self.grow(corner.1 + gutter + stamp.cells.len());
        for (row, runs) in stamp.cells.iter().enumerate() {
            let (x, y) = (corner.0 + gutter, corner.1 + gutter + row);
            for &(from, to) in runs {
                self.taken.set(y, x + from as usize, x + to as usize);
            }
            self.gap[y] = self.taken.longest_gap(y);
        }
    }

    /// Appends free rows up to `height`.
    fn grow(&mut self, height: usize) {
        self.taken.grow(height);
        self.gap.resize(self.taken.height, self.taken.width);
    }
}
