//! Places flat charts in the atlas.
//!
//! Each chart is turned to its smallest bounding box and rasterised: every cell it touches, so that charts on different
//! cells cannot overlap at any resolution. Largest first, each goes to the lowest free place, upright or turned by 90
//! degrees, tested against the cells taken so far (as xatlas does), with the gutter around it free. The strip is open
//! upwards; the texel density is searched so that its height comes out as its width.

use glam::DVec2;

use super::UnwrapParams;
use super::bitmap::Bitmap;
use super::chart::FlatChart;
use super::hull::smallest_box;
use super::surface::Surface;

/// Trials of the density search, and how many of them are near the first.
const TRIALS: usize = 40;
const FINE_TRIALS: usize = 16;

/// First density tried, relative to that of the secant step.
const HEADROOM: f64 = 1.06;

/// Part of the atlas aimed at in the first trial.
const FIRST_FILL: f64 = 0.75;

/// Least area of a chart in cells.
const LEAST_CELLS: f64 = 1.0;

/// Where the charts lie.
pub(super) struct Layout {
    /// For each chart the position of each of its vertices, fractions of the atlas side.
    pub uv: Vec<Vec<DVec2>>,
    /// Atlas sides per unit of the surface.
    pub density: f64,
}

/// A chart turned to its smallest bounding box, lower corner at the origin.
struct Piece {
    points: Vec<DVec2>,
    corners: Vec<[u32; 3]>,
    size: DVec2,
    area: f64,
}

/// A chart rasterised at one density and orientation.
struct Stamp {
    /// Cells taken.
    cells: Vec<Vec<(u32, u32)>>,
    /// Cells that must be free, shifted by the gutter.
    keep_free: Vec<Vec<(u32, u32)>>,
    /// Longest run of each row of `keep_free`.
    widest: Vec<usize>,
    /// Rows of `keep_free` in the order that finds collisions soonest.
    order: Vec<usize>,
    width: usize,
    height: usize,
}

/// The square grid in which charts are placed.
#[derive(Clone, Copy)]
struct Grid {
    side: usize,
    gutter: usize,
    border: usize,
}

/// Places all charts. Never fails: where the gutters leave no room they are given up, then cells are halved.
pub(super) fn pack(surface: &Surface, charts: &[FlatChart], params: &UnwrapParams) -> Layout {
    let pieces: Vec<Piece> = charts.iter().map(|c| Piece::new(surface, c)).collect();
    let side = params.size.max(1) as usize;
    let gutter = params.gutter as usize;
    let mut grid = Grid { side, gutter, border: gutter.div_ceil(2) };
    loop {
        if let Some(layout) = densest(&pieces, grid) {
            return layout;
        }
        grid = match grid.gutter {
            0 => Grid { side: 2 * grid.side, gutter: 0, border: 0 },
            g => Grid { gutter: g / 2, border: (g / 2).div_ceil(2), ..grid },
        };
    }
}

/// The densest layout found. The height of the strip does not rise evenly with the density, so a secant step only finds
/// the neighbourhood, which is then searched downwards.
fn densest(pieces: &[Piece], grid: Grid) -> Option<Layout> {
    let area: f64 = pieces.iter().map(|p| p.area).sum();
    let side = grid.side as f64;
    let first = (FIRST_FILL * side * side / area.max(f64::MIN_POSITIVE)).sqrt();
    let (height, _) = place_all(pieces, first, grid, 4 * grid.side);
    let mut density = first * (side / height as f64).sqrt() * HEADROOM;
    for trial in 0..TRIALS {
        let (height, placed) = place_all(pieces, density, grid, grid.side);
        if height <= grid.side {
            let uv = pieces.iter().zip(placed).map(|(p, at)| p.points_at(density, at, grid)).collect();
            return Some(Layout { uv, density: density / side });
        }
        density *= if trial < FINE_TRIALS { 0.985 } else { 0.9 };
    }
    None
}

/// Cell of a chart's lower corner, and whether it is turned.
#[derive(Clone, Copy, Default)]
struct Place {
    x: usize,
    y: usize,
    turned: bool,
}

/// Places every piece at `density` cells per unit; the height reached, borders included, and the places.
fn place_all(pieces: &[Piece], density: f64, grid: Grid, limit: usize) -> (usize, Vec<Place>) {
    let stamps: Vec<[Stamp; 2]> =
        pieces.iter().map(|p| [false, true].map(|turned| Stamp::new(p, density, turned, grid.gutter))).collect();
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    let longest = |i: usize| stamps[i][0].width.max(stamps[i][0].height);
    let cells = |i: usize| stamps[i][0].width * stamps[i][0].height;
    order.sort_by_key(|&i| (std::cmp::Reverse((longest(i), cells(i))), i));
    let mut strip = Strip { taken: Bitmap::new(grid.side + 2 * grid.gutter, 0), gap: Vec::new(), grid };
    let mut places = vec![Place::default(); pieces.len()];
    let mut top = 0;
    for i in order {
        let upright = strip.lowest(&stamps[i][0], usize::MAX);
        let below = upright.map_or(usize::MAX, |(_, y)| y + stamps[i][0].height);
        let turned = strip.lowest(&stamps[i][1], below);
        let (stamp, place) = match (upright, turned) {
            (_, Some((x, y))) => (&stamps[i][1], Place { x, y, turned: true }),
            (Some((x, y)), None) => (&stamps[i][0], Place { x, y, turned: false }),
            // Wider than the strip both ways: certainly too dense.
            (None, None) => return (usize::MAX, places),
        };
        strip.take(stamp, place);
        places[i] = place;
        top = top.max(place.y + stamp.height);
        if top + grid.border > limit {
            return (usize::MAX, places);
        }
    }
    (top + grid.border, places)
}

/// Cells taken, with a margin of the gutter on each side.
struct Strip {
    taken: Bitmap,
    /// Longest free run of each row.
    gap: Vec<usize>,
    grid: Grid,
}

impl Strip {
    /// The lowest, then leftmost free place whose top is below `limit`.
    fn lowest(&mut self, stamp: &Stamp, limit: usize) -> Option<(usize, usize)> {
        let border = self.grid.border;
        let rightmost = self.grid.side.checked_sub(border + stamp.width).filter(|&x| x >= border)?;
        let mut y = border;
        while y + stamp.height < limit {
            self.grow(y + stamp.keep_free.len());
            let has_room = stamp.order.iter().all(|&row| stamp.widest[row] <= self.gap[y + row]);
            let mut x = if has_room { border } else { usize::MAX };
            while x <= rightmost {
                match self.collision(stamp, x, y) {
                    Some(next) => x = next,
                    None => return Some((x, y)),
                }
            }
            y += 1;
        }
        None
    }

    /// The next abscissa worth trying if the stamp collides at `(x, y)`.
    fn collision(&self, stamp: &Stamp, x: usize, y: usize) -> Option<usize> {
        stamp.order.iter().find_map(|&row| {
            stamp.keep_free[row].iter().find_map(|&(from, to)| {
                let last = self.taken.last_set(y + row, x + from as usize, x + to as usize)?;
                Some(last + 1 - from as usize)
            })
        })
    }

    fn take(&mut self, stamp: &Stamp, place: Place) {
        let gutter = self.grid.gutter;
        self.grow(place.y + gutter + stamp.cells.len());
        for (row, runs) in stamp.cells.iter().enumerate() {
            let (x, y) = (place.x + gutter, place.y + gutter + row);
            for &(from, to) in runs {
                self.taken.set(y, x + from as usize, x + to as usize);
            }
            self.gap[y] = self.taken.longest_gap(y);
        }
    }

    fn grow(&mut self, height: usize) {
        self.taken.grow(height);
        self.gap.resize(self.taken.height, self.taken.width);
    }
}

impl Stamp {
    fn new(piece: &Piece, density: f64, turned: bool, gutter: usize) -> Self {
        let scale = piece.scale(density);
        let place = |p: DVec2| piece.turn(p, turned) * scale;
        let extent = piece.turned_size(turned) * scale;
        let (width, height) = (extent.x.floor() as usize + 1, extent.y.floor() as usize + 1);
        let mut map = Bitmap::new(width, height);
        for corners in &piece.corners {
            map.cover(&corners.map(|v| place(piece.points[v as usize])));
        }
        let cells = map.runs();
        let mut free = Bitmap::new(width + 2 * gutter, height + 2 * gutter);
        for (y, runs) in cells.iter().enumerate() {
            for row in y..=y + 2 * gutter {
                for &(from, to) in runs {
                    free.set(row, from as usize, to as usize + 2 * gutter);
                }
            }
        }
        let keep_free = free.runs();
        let longest = |runs: &Vec<(u32, u32)>| runs.iter().map(|&(from, to)| (to - from) as usize).max().unwrap_or(0);
        let widest = keep_free.iter().map(longest).collect();
        Self { cells, order: coarse_to_fine(keep_free.len()), widest, keep_free, width, height }
    }
}

/// All numbers below `n`, every 16th first, then every 8th and so on.
fn coarse_to_fine(n: usize) -> Vec<usize> {
    let first = (0..n).step_by(16);
    let later = [8, 4, 2, 1].into_iter().flat_map(|step| (step..n).step_by(2 * step));
    first.chain(later).collect()
}

impl Piece {
    fn new(surface: &Surface, flat: &FlatChart) -> Self {
        let (mut area, mut wanted) = (0.0, 0.0);
        for &f in &flat.chart.faces {
            area += surface.area[f as usize];
            wanted += surface.area[f as usize] * surface.density[f as usize] * surface.density[f as usize];
        }
        let axis = smallest_box(&flat.uv).axis * (wanted / area).sqrt();
        let mut points: Vec<DVec2> = flat.uv.iter().map(|p| DVec2::new(axis.dot(*p), axis.perp_dot(*p))).collect();
        let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        points.iter_mut().for_each(|p| *p -= low);
        let size = points.iter().copied().fold(DVec2::ZERO, DVec2::max);
        Self { points, corners: flat.chart.corners.clone(), size, area: wanted }
    }

    /// Cells per unit of this piece: `density`, more for a piece below the least area.
    fn scale(&self, density: f64) -> f64 {
        density.max((LEAST_CELLS / self.area.max(f64::MIN_POSITIVE)).sqrt())
    }

    fn turn(&self, p: DVec2, turned: bool) -> DVec2 {
        if turned { DVec2::new(self.size.y - p.y, p.x) } else { p }
    }

    fn turned_size(&self, turned: bool) -> DVec2 {
        if turned { DVec2::new(self.size.y, self.size.x) } else { self.size }
    }

    fn points_at(&self, density: f64, place: Place, grid: Grid) -> Vec<DVec2> {
        let corner = DVec2::new(place.x as f64, place.y as f64);
        let at = |&p: &DVec2| (corner + self.turn(p, place.turned) * self.scale(density)) / grid.side as f64;
        self.points.iter().map(at).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_visited_once_each() {
        let mut order = coarse_to_fine(37);
        order.sort_unstable();
        assert_eq!(order, (0..37).collect::<Vec<_>>());
        assert!(coarse_to_fine(0).is_empty());
    }

    fn square(side: f64) -> Piece {
        Piece {
            points: vec![DVec2::ZERO, DVec2::X * side, DVec2::ONE * side, DVec2::Y * side],
            corners: vec![[0, 1, 2], [0, 2, 3]],
            size: DVec2::splat(side),
            area: side * side,
        }
    }

    #[test]
    fn charts_keep_the_gutter_between_them_and_half_of_it_to_the_border() {
        let grid = Grid { side: 32, gutter: 4, border: 2 };
        let pieces = [square(9.5), square(9.5), square(9.5), square(9.5)];
        let (height, places) = place_all(&pieces, 1.0, grid, 32);
        let corners: Vec<(usize, usize)> = places.iter().map(|p| (p.x, p.y)).collect();
        assert_eq!(corners, [(2, 2), (16, 2), (2, 16), (16, 16)]);
        assert_eq!(height, 28);
    }

    #[test]
    fn four_equal_squares_fill_the_atlas() {
        let layout =
            densest(&[square(1.0), square(1.0), square(1.0), square(1.0)], Grid { side: 64, gutter: 0, border: 0 });
        assert!(layout.expect("fits").density * 64.0 > 31.0);
    }
}
