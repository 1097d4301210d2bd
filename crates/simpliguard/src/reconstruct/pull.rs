//! Takes the surface from its offset back onto the source.

use glam::Vec3;
use rayon::prelude::*;

use super::Grid;
use crate::Cancellation;
use crate::data::TriMesh;
use crate::geometry::{Bvh, Hit};

/// Part of its distance that a vertex keeps over a solid: enough that no face loses its area at a corner that many
/// vertices are pulled to.
const KEEP_OVER_SOLID: f32 = 0.04;
/// Thickness in cells from which a part is a solid rather than two sheets in one place.
const THICKNESS: f32 = 0.25;

/// Moves each vertex towards the nearest point of the source. Over a sheet it keeps a part `keep` of its distance, so that
/// the sheet's two sides stay apart.
pub(super) fn pull_back(mesh: &mut TriMesh, grid: &Grid, bvh: &Bvh, keep: f32, cancellation: &Cancellation) {
    let reach = (grid.offset + 2.0) * grid.spacing;
    let places = mesh.positions.par_iter_mut().with_min_len(1024);
    places.take_any_while(|_| !cancellation.is_cancelled()).for_each(|p| {
        if let Some(hit) = bvh.closest(*p, reach).or_else(|| bvh.closest(*p, f32::INFINITY)) {
            let keep = if is_over_solid(*p, &hit, grid, bvh) { keep.min(KEEP_OVER_SOLID) } else { keep };
            *p = hit.point + (*p - hit.point) * keep;
        }
    });
}

/// Whether the source has another side behind the point that `p` is pulled to: either what lies beyond the reach of the
/// offset is inside, or a second surface is met before.
fn is_over_solid(p: Vec3, hit: &Hit, grid: &Grid, bvh: &Bvh) -> bool {
    let normal = bvh.normal(hit.triangle);
    let inward = if normal.dot(p - hit.point) > 0.0 { -normal } else { normal };
    let depth = (grid.offset + 1.0) * grid.spacing;
    if grid.is_inside_at(hit.point + inward * depth) {
        return true;
    }
    let thickness = THICKNESS * grid.spacing;
    bvh.occluded(hit.point + inward * thickness, inward, depth)
}
