//! Joins the boundaries of patches that nearly meet.
//!
//! Scans and tessellated CAD come as patches whose boundaries differ by less than a pixel. A collapse moves each boundary on
//! its own, so that gaps open.

use std::collections::{HashMap, HashSet};

use glam::Vec3;

use crate::data::bounds;
use crate::geometry::sorted_half_edges;

/// Longest distance by which a vertex moves, as a fraction of the longest side of the bounding
/// box: a tenth of a pixel in a picture of 512.
const STITCH: f32 = 2e-4;

/// The vertex that replaces each vertex. Most stay. One on a boundary is replaced by the nearest earlier one on a boundary
/// within reach that stays. No triangle loses a corner.
pub(super) fn stitched(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut replaced_by: Vec<u32> = (0..positions.len() as u32).collect();
    let boundary = boundary_vertices(triangles);
    let (low, high) = bounds(positions);
    let reach = ((high - low).max_element() * STITCH).max(f32::MIN_POSITIVE);
    let cell_of = |p: Vec3| ((p - low) / reach).as_ivec3().to_array();
    let neighbours = neighbours(triangles, &boundary);
    let mut cells: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
    for &v in &boundary {
        let p = positions[v as usize];
        let taken: HashSet<u32> = neighbours[&v].iter().map(|&n| replaced_by[n as usize]).collect();
        let near = around(cell_of(p)).filter_map(|cell| cells.get(&cell)).flatten().copied();
        let distance = |r: u32| positions[r as usize].distance(p);
        match near
            .filter(|&r| distance(r) <= reach && !taken.contains(&r))
            .min_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)))
        {
            Some(nearest) => replaced_by[v as usize] = nearest,
            None => cells.entry(cell_of(p)).or_default().push(v),
        }
    }
    replaced_by
}

/// The vertices of edges with one triangle, in order.
fn boundary_vertices(triangles: &[[u32; 3]]) -> Vec<u32> {
    let half_edges = sorted_half_edges(triangles);
    let single = half_edges.chunk_by(|a, b| a.edge == b.edge).filter(|run| run.len() == 1);
    let mut vertices: Vec<u32> = single.flat_map(|run| [run[0].edge.0, run[0].edge.1]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// The vertices that share a triangle with each of `of`.
fn neighbours(triangles: &[[u32; 3]], of: &[u32]) -> HashMap<u32, Vec<u32>> {
    let mut neighbours: HashMap<u32, Vec<u32>> = of.iter().map(|&v| (v, Vec::new())).collect();
    for triangle in triangles {
        for v in triangle {
            if let Some(of_v) = neighbours.get_mut(v) {
                of_v.extend(triangle.iter().filter(|n| *n != v));
            }
        }
    }
    neighbours
}

/// A cell and those around it.
fn around([x, y, z]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..27).map(move |i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of a unit square whose boundaries are `gap` apart.
    fn cracked(gap: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let moved = Vec3::new(gap, gap, 0.0);
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X + moved, Vec3::ONE.with_z(0.0), Vec3::Y + moved];
        (positions, vec![[0, 1, 2], [3, 4, 5]])
    }

    #[test]
    fn boundaries_nearer_than_a_tenth_of_a_pixel_are_joined() {
        let (positions, triangles) = cracked(1e-4);
        assert_eq!(stitched(&positions, &triangles), [0, 1, 2, 1, 4, 2]);
    }

    #[test]
    fn boundaries_farther_apart_stay() {
        let (positions, triangles) = cracked(1e-3);
        assert_eq!(stitched(&positions, &triangles), [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn no_triangle_loses_a_corner() {
        let thin = [Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1e-4, 0.0)];
        assert_eq!(stitched(&thin, &[[0, 1, 2]]), [0, 1, 2]);
    }
}
