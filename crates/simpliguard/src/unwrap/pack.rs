//! Places flat charts in the atlas.
//!
//! Each chart is rotated so that its smallest bounding box is parallel to the axes. It takes every cell that it
//! touches, so charts on different cells cannot overlap at any resolution. The charts are placed one by one, the
//! largest first. Each goes to the lowest free place over the four quarter turns, tested against the cells taken so far
//! (as xatlas does), with the gutter around it free. The strip is open upwards; the texel density is searched so that
//! the height of the strip equals its width.

use glam::DVec2;

use super::chart::FlatChart;
use super::half_edge_mesh::HalfEdgeMesh;
use super::params::UnwrapParams;
use super::piece::{Piece, Stamp};
use super::strip::Strip;
use super::texel_grid::TexelGrid;
use crate::Cancellation;

/// Most trials of the density search.
const TRIALS: usize = 40;

/// Number of trials in fine steps; coarse steps follow.
const FINE_TRIALS: usize = 16;

/// Density of the first trial, relative to that of the secant step.
const HEADROOM: f64 = 1.06;

/// Fraction of the atlas that the first trial aims to fill.
const FIRST_FILL: f64 = 0.75;

/// The same where the gutters take nearly the whole atlas.
const LEAST_FIRST_FILL: f64 = 0.02;

/// Densities tried at full resolution, relative to the one found at half.
const TIGHTER: [f64; 3] = [1.03, 1.02, 1.01];

/// Number of charts up to which several orders are tried.
const FEW: usize = 64;

/// The positions of the charts in the atlas.
pub(super) struct Layout {
    /// The position of each vertex of each chart, as fractions of the atlas side.
    pub uv: Vec<Vec<DVec2>>,
    /// Atlas sides per unit of the surface.
    pub density: f64,
}

/// Places all charts. It never fails: where the gutters leave no room they shrink to nothing, then the cells are
/// halved. No chart is placed if cancelled.
pub(super) fn pack(
    mesh: &HalfEdgeMesh,
    charts: &[FlatChart],
    params: &UnwrapParams,
    cancellation: &Cancellation,
) -> Layout {
    let pieces: Vec<Piece> = charts.iter().map(|c| Piece::new(mesh, c)).collect();
    let mut grid = TexelGrid::new(params.size.max(1) as usize, params.gutter as usize);
    while !pieces.is_empty() && !cancellation.is_cancelled() {
        if let Some(layout) = densest(&pieces, grid, cancellation) {
            return layout;
        }
        grid = match grid.gutter {
            0 => TexelGrid::new(2 * grid.side, 0),
            g => TexelGrid::new(grid.side, g / 2),
        };
    }
    Layout { uv: Vec::new(), density: 0.0 }
}

/// The densest layout found over the orders. The search uses cells of twice the width, which takes a quarter of the
/// time; then higher densities are tried with the cells of `grid`.
fn densest(pieces: &[Piece], grid: TexelGrid, cancellation: &Cancellation) -> Option<Layout> {
    let orders = orders(pieces);
    let Some((found, order)) = grid.halved().and_then(|coarse| search(pieces, &orders, coarse, cancellation)) else {
        return search(pieces, &orders, grid, cancellation).map(|(layout, _)| layout);
    };
    let tighter = TIGHTER.iter().find_map(|factor| layout(pieces, order, found.density * factor, grid, 1.0));
    Some(tighter.map_or(found, |(layout, _)| layout))
}

/// Orders in which to place the charts, largest first: by the area of the bounding box and, for few charts, also by its
/// longer and by its shorter side.
fn orders(pieces: &[Piece]) -> Vec<Vec<usize>> {
    let keys: [fn(DVec2) -> f64; 3] = [DVec2::element_product, DVec2::max_element, DVec2::min_element];
    let wanted = if pieces.len() <= FEW { 3 } else { 1 };
    let sorted = |key: &fn(DVec2) -> f64| {
        let mut order: Vec<usize> = (0..pieces.len()).collect();
        order.sort_by(|&a, &b| key(pieces[b].extent[0]).total_cmp(&key(pieces[a].extent[0])).then(a.cmp(&b)));
        order
    };
    keys[..wanted].iter().map(sorted).collect()
}

/// The densest layout over `orders` and its order. The height of the strip is no monotonic function of the density, so
/// a secant step only finds a start, from which lower densities are tried.
fn search<'a>(
    pieces: &[Piece],
    orders: &'a [Vec<usize>],
    grid: TexelGrid,
    cancellation: &Cancellation,
) -> Option<(Layout, &'a [usize])> {
    let mut start = first_density(pieces, grid);
    let (_, height) = (0..TRIALS).find_map(|_| {
        let found = layout(pieces, orders.first()?, start, grid, 2.0);
        start *= if found.is_some() { 1.0 } else { 0.8 };
        found
    })?;
    start *= HEADROOM / height.sqrt();
    let mut best: Option<(Layout, &[usize])> = None;
    for order in orders {
        let mut density = start;
        for trial in 0..TRIALS {
            let is_denser = best.as_ref().is_some_and(|(found, _)| found.density >= density);
            if is_denser || cancellation.is_cancelled() {
                break;
            }
            if let Some((found, _)) = layout(pieces, order, density, grid, 1.0) {
                best = Some((found, order));
                break;
            }
            density *= if trial < FINE_TRIALS { 0.985 } else { 0.9 };
        }
    }
    best
}

/// The density at which all charts, each with the gutter on two sides, take the fraction of the atlas that the first
/// trial aims to fill.
fn first_density(pieces: &[Piece], grid: TexelGrid) -> f64 {
    let gutter = grid.gutter as f64 / grid.side as f64;
    let (mut area, mut sides) = (0.0, 0.0);
    for piece in pieces {
        area += piece.area;
        sides += 0.5 * gutter * piece.extent[0].element_sum();
    }
    let room = (FIRST_FILL - gutter * gutter * pieces.len() as f64).max(LEAST_FIRST_FILL);
    ((sides * sides + area * room).sqrt() - sides) / area.max(f64::MIN_POSITIVE)
}

/// The layout at `density` atlas sides per unit and its height in atlas sides; `None` if that is above `limit`.
fn layout(pieces: &[Piece], order: &[usize], density: f64, grid: TexelGrid, limit: f64) -> Option<(Layout, f64)> {
    let side = grid.side as f64;
    let (height, places) = place_all(pieces, order, density * side, grid, (limit * side) as usize)?;
    let at = |(piece, place): (&Piece, Place)| {
        let corner = DVec2::new(place.x as f64, place.y as f64);
        let points = piece.points_at(density * side, place.turn, corner, grid);
        points.into_iter().map(|p| p / side).collect()
    };
    let uv = pieces.iter().zip(places).map(at).collect();
    Some((Layout { uv, density }, height as f64 / side))
}

/// The cell of a chart's lower corner, and its number of quarter turns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Place {
    x: usize,
    y: usize,
    turn: usize,
}

/// Places every chart at `density` cells per unit. The result is the height of the strip with its borders, and the
/// places; `None` if the height would exceed `limit`.
fn place_all(
    pieces: &[Piece],
    order: &[usize],
    density: f64,
    grid: TexelGrid,
    limit: usize,
) -> Option<(usize, Vec<Place>)> {
    let stamps: Vec<[Stamp; 4]> = pieces.iter().map(|p| p.stamps(density, grid)).collect();
    let mut strip = Strip::new(grid);
    let mut places = vec![Place::default(); pieces.len()];
    let mut top = 0;
    for &i in order {
        let mut best = None;
        let mut room = limit.checked_sub(grid.border)? + 1;
        for (turn, stamp) in stamps[i].iter().enumerate() {
            if let Some((x, y)) = strip.lowest(stamp, room) {
                room = y + stamp.height;
                best = Some(Place { x, y, turn });
            }
        }
        let place = best?;
        strip.take(&stamps[i][place.turn], (place.x, place.y));
        places[i] = place;
        top = top.max(room);
    }
    Some((top + grid.border, places))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(side: f64) -> Piece {
        let points = vec![DVec2::ZERO, DVec2::X * side, DVec2::ONE * side, DVec2::Y * side];
        Piece::of(points, vec![[0, 1, 2], [0, 2, 3]], side * side)
    }

    #[test]
    fn charts_keep_the_gutter_between_them_and_half_of_it_to_the_border() {
        let grid = TexelGrid::new(32, 4);
        let pieces = [square(9.5), square(9.5), square(9.5), square(9.5)];
        let (height, places) = place_all(&pieces, &[0, 1, 2, 3], 1.0, grid, 32).expect("fits");
        let corners: Vec<(usize, usize)> = places.iter().map(|p| (p.x, p.y)).collect();
        assert_eq!(corners, [(2, 2), (16, 2), (2, 16), (16, 16)]);
        assert_eq!(height, 28);
    }

    #[test]
    fn four_equal_squares_fill_the_atlas() {
        let layout = densest(
            &[square(1.0), square(1.0), square(1.0), square(1.0)],
            TexelGrid::new(64, 0),
            &Cancellation::default(),
        );
        assert!(layout.expect("fits").density * 64.0 > 31.0);
    }
}
