//! Pulls the surface from its offset back onto the source.

use glam::Vec3;
use rayon::prelude::*;

use super::grid::BrickGrid;
use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::{Bvh, Hit};

/// Fraction of its distance that a vertex keeps over a solid. Many vertices may be pulled to one corner of the source;
/// this fraction is enough that their faces keep an area.
const KEEP_OVER_SOLID: f32 = 0.04;
/// Thickness in cells above which a part is a solid rather than two coincident sheets.
const THICKNESS: f32 = 0.25;

/// Moves each vertex towards the nearest point of the source. Over a sheet the vertex keeps the fraction `keep` of its
/// distance, so that the two sides of the sheet stay apart.
pub(super) fn pull_back(mesh: &mut TriMesh, grid: &BrickGrid, bvh: &Bvh, keep: f32, cancellation: &Cancellation) {
    let reach = (grid.offset + 2.0) * grid.spacing;
    let positions = mesh.positions.par_iter_mut().with_min_len(1024);
    positions.take_any_while(|_| !cancellation.is_cancelled()).for_each(|p| {
        if let Some(hit) = bvh.closest(*p, reach).or_else(|| bvh.closest(*p, f32::INFINITY)) {
            let keep = if is_over_solid(*p, &hit, grid, bvh) { keep.min(KEEP_OVER_SOLID) } else { keep };
            *p = hit.point + (*p - hit.point) * keep;
        }
    });
}

/// True if the source is a solid at the point that `p` is pulled to: the grid is inside one cell beyond the offset
/// behind that point, or a ray meets a second surface before.
fn is_over_solid(p: Vec3, hit: &Hit, grid: &BrickGrid, bvh: &Bvh) -> bool {
    let normal = bvh.normal(hit.triangle);
    let inward = if normal.dot(p - hit.point) > 0.0 { -normal } else { normal };
    let depth = (grid.offset + 1.0) * grid.spacing;
    if grid.is_inside_at(hit.point + inward * depth) {
        return true;
    }
    let thickness = THICKNESS * grid.spacing;
    bvh.occluded(hit.point + inward * thickness, inward, depth)
}
