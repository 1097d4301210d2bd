//! Surface nets: one vertex per cell that the surface passes, one quad per edge that it crosses.

use glam::{IVec3, Vec3, Vec3A};
use rayon::prelude::*;

use super::{BRICK, BRICK_SAMPLES, Grid, cell_mask};
use crate::data::TriMesh;

/// The twelve edges of a cell as pairs of corners.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];
/// A cell without a vertex.
const NONE: u32 = u32::MAX;

/// Vertices of one brick, and which of its cells has which.
struct BrickVertices {
    positions: Vec<Vec3>,
    cells: Box<[u32; BRICK_SAMPLES]>,
}

/// The boundary between inside and outside as triangles.
pub(super) fn extract(grid: &Grid) -> TriMesh {
    let vertices: Vec<BrickVertices> =
        (0..grid.bricks.len()).into_par_iter().map(|brick| vertices_of(grid, brick)).collect();
    let mut first = Vec::with_capacity(vertices.len());
    let mut count = 0u32;
    for brick in &vertices {
        first.push(count);
        count += brick.positions.len() as u32;
    }
    let triangles = (0..grid.bricks.len())
        .into_par_iter()
        .flat_map_iter(|brick| triangles_of(grid, &vertices, &first, brick))
        .collect();
    TriMesh { positions: vertices.into_iter().flat_map(|v| v.positions).collect(), triangles }
}

fn corner_offset(corner: usize) -> IVec3 {
    IVec3::new((corner & 1) as i32, (corner >> 1 & 1) as i32, (corner >> 2) as i32)
}

fn vertices_of(grid: &Grid, brick: usize) -> BrickVertices {
    let base = grid.bricks[brick].coordinate * BRICK as i32;
    let block = grid.inside_block(brick);
    let mut out = BrickVertices { positions: Vec::new(), cells: Box::new([NONE; BRICK_SAMPLES]) };
    for i in 0..BRICK_SAMPLES {
        let (x, y, z) = (i % BRICK, i / BRICK % BRICK, i / (BRICK * BRICK));
        let mask = cell_mask(&block, x, y, z);
        if mask == 0 || mask == 255 {
            continue;
        }
        let cell = base + IVec3::new(x as i32, y as i32, z as i32);
        out.cells[i] = out.positions.len() as u32;
        out.positions.push((grid.origin + (cell.as_vec3a() + crossing_mean(grid, cell, mask)) * grid.spacing).into());
    }
    out
}

/// Mean of the points where the surface crosses the cell's edges, in cells.
fn crossing_mean(grid: &Grid, cell: IVec3, mask: u8) -> Vec3A {
    let inside = |corner: usize| mask >> corner & 1 == 1;
    // The flood and the repair may disagree with the distance: its sign is then forced, by a small value.
    let smallest = 0.02;
    let level = |corner: usize| {
        let value = grid.level(cell + corner_offset(corner));
        if inside(corner) { value.min(-smallest) } else { value.max(smallest) }
    };
    let (mut sum, mut count) = (Vec3A::ZERO, 0.0);
    for (a, b) in EDGES {
        if inside(a) != inside(b) {
            let (la, lb) = (level(a), level(b));
            let (pa, pb) = (corner_offset(a).as_vec3a(), corner_offset(b).as_vec3a());
            sum += pa + (pb - pa) * (la / (la - lb));
            count += 1.0;
        }
    }
    sum / count
}

fn triangles_of(grid: &Grid, vertices: &[BrickVertices], first: &[u32], brick: usize) -> Vec<[u32; 3]> {
    const STRIDE: [usize; 3] = [1, 9, 81];
    let base = grid.bricks[brick].coordinate * BRICK as i32;
    let block = grid.inside_block(brick);
    let vertex = |cell: IVec3| -> Option<u32> {
        let owner = grid.brick_of(cell)?;
        let vertex = vertices[owner].cells[super::local_index(cell)];
        (vertex != NONE).then(|| first[owner] + vertex)
    };
    let mut out = Vec::new();
    for i in 0..BRICK_SAMPLES {
        let (x, y, z) = (i % BRICK, i / BRICK % BRICK, i / (BRICK * BRICK));
        let here = block[x + 9 * y + 81 * z];
        for axis in 0..3 {
            if here == block[x + 9 * y + 81 * z + STRIDE[axis]] {
                continue;
            }
            let cell = base + IVec3::new(x as i32, y as i32, z as i32);
            let (mut u, mut v) = (IVec3::ZERO, IVec3::ZERO);
            u[(axis + 1) % 3] = 1;
            v[(axis + 2) % 3] = 1;
            let around = [vertex(cell - u - v), vertex(cell - v), vertex(cell), vertex(cell - u)];
            let [Some(a), Some(b), Some(c), Some(d)] = around else { continue };
            let [a, b, c, d] = if here { [a, b, c, d] } else { [d, c, b, a] };
            out.push([a, b, c]);
            out.push([a, c, d]);
        }
    }
    out
}
