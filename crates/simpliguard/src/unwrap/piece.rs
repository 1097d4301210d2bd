//! Charts for the packer: rotated so that their smallest bounding box is parallel to the axes, and rasterised.

use glam::DVec2;

use super::bitmap::Bitmap;
use super::chart::FlatChart;
use super::half_edge_mesh::HalfEdgeMesh;
use super::hull::smallest_box;
use super::texel_grid::TexelGrid;

/// A chart to place.
pub(super) struct Piece {
    /// Vertices without and with a quarter turn. The sides of the smallest bounding box are parallel to the axes, and
    /// its lower corner is the origin.
    points: [Vec<DVec2>; 2],
    /// Sides of the bounding box without and with a quarter turn.
    pub extent: [DVec2; 2],
    corners: Vec<[u32; 3]>,
    /// Area times squared density.
    pub area: f64,
}

/// A chart rasterised at one density and orientation.
pub(super) struct Stamp {
    /// Cells taken.
    pub cells: Vec<Runs>,
    /// Cells that must be free: those within the gutter of a cell taken. Rows and columns are shifted by the gutter.
    pub keep_free: Vec<Runs>,
    /// Longest run of each row of `keep_free`.
    pub widest: Vec<usize>,
    /// Rows of `keep_free` in the order that tends to find a collision first.
    pub order: Vec<usize>,
    pub width: usize,
    pub height: usize,
}

/// Runs `from..to` of set cells of a row.
type Runs = Vec<(u32, u32)>;

impl Piece {
    /// A chart to place.
    pub(super) fn new(mesh: &HalfEdgeMesh, flat: &FlatChart) -> Self {
        let (mut area, mut wanted) = (0.0, 0.0);
        for &f in &flat.chart.faces {
            area += mesh.area[f as usize];
            wanted += mesh.area[f as usize] * mesh.density[f as usize] * mesh.density[f as usize];
        }
        let axis = smallest_box(&flat.uv).axis * (wanted / area).sqrt();
        let upright = flat.uv.iter().map(|p| DVec2::new(axis.dot(*p), axis.perp_dot(*p))).collect();
        Self::of(upright, flat.chart.corners.clone(), wanted)
    }

    /// A piece from vertices whose smallest bounding box is parallel to the axes.
    pub(super) fn of(upright: Vec<DVec2>, corners: Vec<[u32; 3]>, area: f64) -> Self {
        let turned = upright.iter().map(|p| p.perp()).collect();
        let points = [upright, turned].map(|points| {
            let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
            points.into_iter().map(|p| p - low).collect::<Vec<_>>()
        });
        let extent = [0, 1].map(|turn: usize| points[turn].iter().copied().fold(DVec2::ZERO, DVec2::max));
        Self { points, extent, corners, area }
    }

    /// Cells per unit of this piece: `density`, or more if the piece would be below the least area.
    fn scale(&self, density: f64, grid: TexelGrid) -> f64 {
        density.max((grid.least_area / self.area.max(f64::MIN_POSITIVE)).sqrt())
    }

    /// Width and height of the bounding box in cells.
    fn cells(&self, turn: usize, scale: f64) -> (usize, usize) {
        let extent = self.extent[turn % 2] * scale;
        (extent.x as usize + 1, extent.y as usize + 1)
    }

    /// Rasters after 0, 1, 2 and 3 quarter turns. The last two are the first two, rotated by half a turn cell by cell.
    pub(super) fn stamps(&self, density: f64, grid: TexelGrid) -> [Stamp; 4] {
        let [upright, turned] = [0, 1].map(|turn| self.stamp(density, turn, grid));
        let opposite = [upright.half_turned(grid.gutter), turned.half_turned(grid.gutter)];
        let [upside_down, turned_back] = opposite;
        [upright, turned, upside_down, turned_back]
    }

    fn stamp(&self, density: f64, turn: usize, grid: TexelGrid) -> Stamp {
        let scale = self.scale(density, grid);
        let (width, height) = self.cells(turn, scale);
        let mut map = Bitmap::new(width, height);
        for corners in &self.corners {
            map.cover(&corners.map(|v| self.points[turn][v as usize] * scale));
        }
        Stamp::of(map.runs(), (width, height), grid.gutter)
    }

    /// The vertices in cells after `turn` quarter turns, with the lower corner of the stamp at `corner`.
    pub(super) fn points_at(&self, density: f64, turn: usize, corner: DVec2, grid: TexelGrid) -> Vec<DVec2> {
        let scale = self.scale(density, grid);
        let (width, height) = self.cells(turn, scale);
        let opposite = corner + DVec2::new(width as f64, height as f64);
        let at = |&p: &DVec2| if turn < 2 { corner + p * scale } else { opposite - p * scale };
        self.points[turn % 2].iter().map(at).collect()
    }
}

impl Stamp {
    fn of(cells: Vec<Runs>, (width, height): (usize, usize), gutter: usize) -> Self {
        let mut free = Bitmap::new(width + 2 * gutter, height + 2 * gutter);
        for (y, runs) in cells.iter().enumerate() {
            for row in y..=y + 2 * gutter {
                for &(from, to) in runs {
                    free.set(row, from as usize, to as usize + 2 * gutter);
                }
            }
        }
        Self::with(cells, free.runs(), (width, height))
    }

    fn with(cells: Vec<Runs>, keep_free: Vec<Runs>, (width, height): (usize, usize)) -> Self {
        let longest = |runs: &Runs| runs.iter().map(|&(from, to)| (to - from) as usize).max().unwrap_or(0);
        let widest = keep_free.iter().map(longest).collect();
        Self { cells, order: coarse_to_fine(keep_free.len()), widest, keep_free, width, height }
    }

    fn half_turned(&self, gutter: usize) -> Self {
        let turn = |rows: &[Runs], width: usize| -> Vec<Runs> {
            let mirror = |&(from, to): &(u32, u32)| (width as u32 - to, width as u32 - from);
            rows.iter().rev().map(|runs| runs.iter().rev().map(mirror).collect()).collect()
        };
        let keep_free = turn(&self.keep_free, self.width + 2 * gutter);
        Self::with(turn(&self.cells, self.width), keep_free, (self.width, self.height))
    }
}

/// All numbers below `n`, every 16th first, then every 8th and so on.
fn coarse_to_fine(n: usize) -> Vec<usize> {
    let first = (0..n).step_by(16);
    let later = [8, 4, 2, 1].into_iter().flat_map(|step| (step..n).step_by(2 * step));
    first.chain(later).collect()
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

    #[test]
    fn every_turn_covers_the_cells_of_its_points() {
        let points = vec![DVec2::ZERO, DVec2::new(7.3, 0.4), DVec2::new(2.2, 4.9)];
        let piece = Piece::of(points, vec![[0, 1, 2]], 17.0);
        let grid = TexelGrid::new(64, 2);
        for (turn, stamp) in piece.stamps(1.0, grid).iter().enumerate() {
            let at = piece.points_at(1.0, turn, DVec2::ZERO, grid);
            let mut map = Bitmap::new(stamp.width, stamp.height);
            map.cover(&[at[0], at[1], at[2]]);
            assert_eq!(map.runs(), stamp.cells, "{turn}");
            assert!((at[1] - at[0]).perp_dot(at[2] - at[0]) > 0.0);
        }
    }
}
