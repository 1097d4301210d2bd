//! Surface nets: one vertex per cell that the surface crosses, one quad per edge that it crosses.

use glam::{IVec3, Vec3, Vec3A};
use rayon::prelude::*;

use super::grid::{BRICK, BRICK_SAMPLES, BrickGrid, cell_mask, corner_offset, local_index};
use crate::data::TriMesh;

/// The twelve edges of a cell as pairs of corners.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];
/// The vertex of a cell that has none.
const NO_VERTEX: u32 = u32::MAX;

/// Least distance of a sample's level from zero, in cells. The flood and the repair decide the side of a sample and may
/// disagree with its distance.
const LEAST_LEVEL: f32 = 0.02;

/// Vertices of one brick.
struct BrickVertices {
    positions: Vec<Vec3>,
    /// Vertex of each cell, or [`NO_VERTEX`].
    cells: Box<[u32; BRICK_SAMPLES]>,
}

/// The boundary between inside and outside as triangles.
pub(super) fn extract(grid: &BrickGrid) -> TriMesh {
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

fn vertices_of(grid: &BrickGrid, brick: usize) -> BrickVertices {
    let base = grid.bricks[brick].coordinate * BRICK as i32;
    let block = grid.inside_block(brick);
    let mut out = BrickVertices { positions: Vec::new(), cells: Box::new([NO_VERTEX; BRICK_SAMPLES]) };
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
fn crossing_mean(grid: &BrickGrid, cell: IVec3, mask: u8) -> Vec3A {
    let inside = |corner: usize| mask >> corner & 1 == 1;
    let level = |corner: usize| {
        let value = grid.level(cell + corner_offset(corner as i32));
        if inside(corner) { value.min(-LEAST_LEVEL) } else { value.max(LEAST_LEVEL) }
    };
    let (mut sum, mut count) = (Vec3A::ZERO, 0.0);
    for (a, b) in EDGES {
        if inside(a) != inside(b) {
            let (la, lb) = (level(a), level(b));
            let (pa, pb) = (corner_offset(a as i32).as_vec3a(), corner_offset(b as i32).as_vec3a());
            sum += pa + (pb - pa) * (la / (la - lb));
            count += 1.0;
        }
    }
    sum / count
}

fn triangles_of(grid: &BrickGrid, vertices: &[BrickVertices], first: &[u32], brick: usize) -> Vec<[u32; 3]> {
    const STRIDE: [usize; 3] = [1, 9, 81];
    let base = grid.bricks[brick].coordinate * BRICK as i32;
    let block = grid.inside_block(brick);
    let vertex = |cell: IVec3| -> Option<u32> {
        let owner = grid.brick_of(cell)?;
        let vertex = vertices[owner].cells[local_index(cell)];
        (vertex != NO_VERTEX).then(|| first[owner] + vertex)
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
