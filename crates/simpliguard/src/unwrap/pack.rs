//! Places flat charts in the atlas.
//!
//! Each chart is turned to its smallest bounding box and rasterised: every cell it touches, so that charts on different
//! cells cannot overlap at any resolution. Largest first, each goes to the lowest free place, at any of the four
//! quarter turns, tested against the cells taken so far (as xatlas does), with the gutter around it free. The strip is open
//! upwards; the texel density is searched so that its height comes out as its width.

use std::collections::BTreeMap;

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

/// Densities tried at full resolution, relative to the one found at half.
const TIGHTER: [f64; 3] = [1.03, 1.02, 1.01];

/// Side below which no coarser grid is searched.
const LEAST_COARSE_SIDE: usize = 256;

/// Longest side in cells of a chart whose search starts where that of the last alike ended.
const SMALL: usize = 48;

/// Least area of a chart in texels.
const LEAST_TEXELS: f64 = 1.0;

/// Where the charts lie.
pub(super) struct Layout {
    /// For each chart the position of each of its vertices, fractions of the atlas side.
    pub uv: Vec<Vec<DVec2>>,
    /// Atlas sides per unit of the surface.
    pub density: f64,
}

/// A chart to place.
struct Piece {
    /// Vertices for each quarter turn, sides parallel to those of the smallest bounding box, its lower corner at the
    /// origin.
    turns: [Vec<DVec2>; 4],
    corners: Vec<[u32; 3]>,
    /// Area times squared density.
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
    /// Least area of a chart in cells.
    least_area: f64,
}

impl Grid {
    fn new(side: usize, gutter: usize) -> Self {
        Self { side, gutter, border: gutter.div_ceil(2), least_area: LEAST_TEXELS }
    }

    /// The grid of cells twice as wide; what fits there fits here.
    fn halved(self) -> Option<Self> {
        (self.side.is_multiple_of(2) && self.side >= LEAST_COARSE_SIDE).then(|| Self {
            side: self.side / 2,
            gutter: self.gutter.div_ceil(2),
            border: self.border.div_ceil(2),
            least_area: 0.25 * self.least_area,
        })
    }
}

/// Places all charts. Never fails: where the gutters leave no room they are given up, then cells are halved.
pub(super) fn pack(surface: &Surface, charts: &[FlatChart], params: &UnwrapParams) -> Layout {
    let pieces: Vec<Piece> = charts.iter().map(|c| Piece::new(surface, c)).collect();
    let mut grid = Grid::new(params.size.max(1) as usize, params.gutter as usize);
    loop {
        if let Some(layout) = densest(&pieces, grid) {
            return layout;
        }
        grid = match grid.gutter {
            0 => Grid::new(2 * grid.side, 0),
            g => Grid::new(grid.side, g / 2),
        };
    }
}

/// The densest layout found. It is searched with cells of twice the width, which takes a quarter of the time, and then
/// tightened.
fn densest(pieces: &[Piece], grid: Grid) -> Option<Layout> {
    let Some(found) = grid.halved().and_then(|coarse| search(pieces, coarse)) else { return search(pieces, grid) };
    let tighter = TIGHTER.iter().find_map(|factor| layout(pieces, found.density * factor, grid, 1.0));
    Some(tighter.map_or(found, |(layout, _)| layout))
}

/// The height of the strip does not rise evenly with the density, so a secant step only finds the neighbourhood, which
/// is then searched downwards.
fn search(pieces: &[Piece], grid: Grid) -> Option<Layout> {
    let area: f64 = pieces.iter().map(|p| p.area).sum();
    let first = (FIRST_FILL / area.max(f64::MIN_POSITIVE)).sqrt();
    let (start, height) = (0..TRIALS).find_map(|trial| layout(pieces, first * 0.8f64.powi(trial as i32), grid, 2.0))?;
    let mut density = start.density / height.sqrt() * HEADROOM;
    for trial in 0..TRIALS {
        if let Some((found, _)) = layout(pieces, density, grid, 1.0) {
            return Some(found);
        }
        density *= if trial < FINE_TRIALS { 0.985 } else { 0.9 };
    }
    None
}

/// The layout at `density` atlas sides per unit and its height in atlas sides; `None` if that is above `limit`.
fn layout(pieces: &[Piece], density: f64, grid: Grid, limit: f64) -> Option<(Layout, f64)> {
    let side = grid.side as f64;
    let (height, places) = place_all(pieces, density * side, grid, (limit * side) as usize)?;
    let uv = pieces.iter().zip(places).map(|(p, at)| p.points_at(density * side, at, grid)).collect();
    Some((Layout { uv, density }, height as f64 / side))
}

/// Cell of a chart's lower corner, and its quarter turns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Place {
    x: usize,
    y: usize,
    turn: usize,
}

/// Places every piece at `density` cells per unit; the height reached, borders included, and the places. `None` once it
/// would pass `limit`.
fn place_all(pieces: &[Piece], density: f64, grid: Grid, limit: usize) -> Option<(usize, Vec<Place>)> {
    let stamps: Vec<[Stamp; 4]> =
        pieces.iter().map(|p| std::array::from_fn(|turn| Stamp::new(p, density, turn, grid))).collect();
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    let longest = |i: usize| stamps[i][0].width.max(stamps[i][0].height);
    let cells = |i: usize| stamps[i][0].width * stamps[i][0].height;
    order.sort_by_key(|&i| (std::cmp::Reverse((longest(i), cells(i))), i));
    let mut strip =
        Strip { taken: Bitmap::new(grid.side + 2 * grid.gutter, 0), gap: Vec::new(), reached: BTreeMap::new(), grid };
    let mut places = vec![Place::default(); pieces.len()];
    let mut top = 0;
    for i in order {
        let mut best = None;
        let mut room = limit.checked_sub(grid.border)? + 1;
        for (turn, stamp) in stamps[i].iter().enumerate() {
            if let Some((x, y)) = strip.lowest(stamp, room) {
                room = y + stamp.height;
                best = Some(Place { x, y, turn });
            }
        }
        places[i] = best?;
        strip.take(&stamps[i][places[i].turn], places[i]);
        top = top.max(room);
    }
    Some((top + grid.border, places))
}

/// Cells taken, with a margin of the gutter on each side.
struct Strip {
    taken: Bitmap,
    /// Longest free run of each row.
    gap: Vec<usize>,
    /// Where the search for a small stamp of about one width and height ended last: below there is hardly room for
    /// the next of its kind.
    reached: BTreeMap<(usize, usize), usize>,
    grid: Grid,
}

impl Strip {
    /// The lowest, then leftmost free place whose top is below `room`.
    fn lowest(&mut self, stamp: &Stamp, room: usize) -> Option<(usize, usize)> {
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
    fn new(piece: &Piece, density: f64, turn: usize, grid: Grid) -> Self {
        let (scale, gutter) = (piece.scale(density, grid), grid.gutter);
        let points = &piece.turns[turn];
        let extent = points.iter().copied().fold(DVec2::ZERO, DVec2::max) * scale;
        let (width, height) = (extent.x.floor() as usize + 1, extent.y.floor() as usize + 1);
        let mut map = Bitmap::new(width, height);
        for corners in &piece.corners {
            map.cover(&corners.map(|v| points[v as usize] * scale));
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
        let upright = flat.uv.iter().map(|p| DVec2::new(axis.dot(*p), axis.perp_dot(*p))).collect();
        Self::of(upright, flat.chart.corners.clone(), wanted)
    }

    fn of(upright: Vec<DVec2>, corners: Vec<[u32; 3]>, area: f64) -> Self {
        let mut points = upright;
        let turns = std::array::from_fn(|_| {
            let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
            let turned = points.iter().map(|p| *p - low).collect();
            points.iter_mut().for_each(|p| *p = p.perp());
            turned
        });
        Self { turns, corners, area }
    }

    /// Cells per unit of this piece: `density`, more for a piece below the least area.
    fn scale(&self, density: f64, grid: Grid) -> f64 {
        density.max((grid.least_area / self.area.max(f64::MIN_POSITIVE)).sqrt())
    }

    fn points_at(&self, density: f64, place: Place, grid: Grid) -> Vec<DVec2> {
        let corner = DVec2::new(place.x as f64, place.y as f64);
        let at = |&p: &DVec2| (corner + p * self.scale(density, grid)) / grid.side as f64;
        self.turns[place.turn].iter().map(at).collect()
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
        let points = vec![DVec2::ZERO, DVec2::X * side, DVec2::ONE * side, DVec2::Y * side];
        Piece::of(points, vec![[0, 1, 2], [0, 2, 3]], side * side)
    }

    #[test]
    fn charts_keep_the_gutter_between_them_and_half_of_it_to_the_border() {
        let grid = Grid::new(32, 4);
        let pieces = [square(9.5), square(9.5), square(9.5), square(9.5)];
        let (height, places) = place_all(&pieces, 1.0, grid, 32).expect("fits");
        let corners: Vec<(usize, usize)> = places.iter().map(|p| (p.x, p.y)).collect();
        assert_eq!(corners, [(2, 2), (16, 2), (2, 16), (16, 16)]);
        assert_eq!(height, 28);
    }

    #[test]
    fn four_equal_squares_fill_the_atlas() {
        let layout = densest(&[square(1.0), square(1.0), square(1.0), square(1.0)], Grid::new(64, 0));
        assert!(layout.expect("fits").density * 64.0 > 31.0);
    }
}
