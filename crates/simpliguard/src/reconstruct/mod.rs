//! A watertight manifold around any triangle soup.
//!
//! 1. An unsigned distance field in a narrow band, in sparse bricks of 8 x 8 x 8 samples found by octree descent
//!    (`field`).
//! 2. Outside is what a flood from the corner reaches through samples farther than `offset` from the surface. Every
//!    edge that crosses the surface has an end within half a cell of it, so with `offset` above one half nothing leaks;
//!    holes narrower than about two offsets close (`flood`).
//! 3. Samples are added to the inside until no 2 x 2 face and no cell is connected across a diagonal only
//!    (well-composed sets, Latecki 1997): then the boundary is a 2-manifold and one vertex per cell is enough
//!    (`repair`).
//! 4. Surface nets (Gibson 1998) place one vertex per boundary cell, and each is pulled back onto the source
//!    (`nets`).
//!
//! Open sheets become slabs of twice the offset, pulled back to a tenth of a cell; solids, however thin, are pulled back
//! almost onto their surface. Parts thinner than a cell are kept.
//! Self-intersections after the pull are possible where two sheets lie within a cell.

mod field;
mod flood;
mod nets;
mod pull;
mod repair;
mod triangle;

use glam::{IVec3, Vec3, Vec3A};

use crate::Cancellation;
use crate::data::{Reconstruction, TriMesh};
use crate::geometry::Bvh;

/// Samples along the side of a brick.
const BRICK: usize = 8;
/// Samples of a brick.
const BRICK_SAMPLES: usize = BRICK * BRICK * BRICK;
/// Index of a brick that holds no samples.
const NO_BRICK: u32 = u32::MAX;

/// Wraps the triangles of `bvh`, given again as indexed positions. Empty for an empty source; unfinished if cancelled.
pub fn reconstruct(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    bvh: &Bvh,
    params: &Reconstruction,
    cancellation: &Cancellation,
) -> TriMesh {
    if triangles.is_empty() {
        return TriMesh::default();
    }
    let mut grid = field::build(positions, triangles, params, cancellation);
    if cancellation.is_cancelled() {
        return TriMesh::default();
    }
    flood::mark_inside(&mut grid);
    repair::make_well_composed(&mut grid);
    if cancellation.is_cancelled() {
        return TriMesh::default();
    }
    let mut mesh = nets::extract(&grid);
    pull::pull_back(&mut mesh, &grid, bvh, params.keep, cancellation);
    mesh
}

/// A sparse narrow-band grid.
struct Grid {
    /// Bricks along a side.
    side: i32,
    /// Distance between samples.
    spacing: f32,
    /// Position of sample (0, 0, 0).
    origin: Vec3A,
    /// Surface level in the distance field, in cells.
    offset: f32,
    /// Index into `bricks` by brick coordinate, or [`NO_BRICK`].
    table: Vec<u32>,
    bricks: Vec<Brick>,
    /// Whether the flood reached a brick without samples, by brick coordinate.
    empty_outside: Vec<bool>,
}

/// 8 x 8 x 8 samples near the surface.
struct Brick {
    /// In bricks.
    coordinate: IVec3,
    /// Distance to the source in cells, x fastest; the largest number where it is too far from the surface level to matter.
    distance: Box<[f32; BRICK_SAMPLES]>,
    /// One bit per sample.
    inside: [u64; BRICK],
}

impl Brick {
    fn is_inside(&self, sample: usize) -> bool {
        self.inside[sample >> 6] >> (sample & 63) & 1 == 1
    }

    fn set_inside(&mut self, sample: usize, inside: bool) {
        let bit = 1 << (sample & 63);
        if inside { self.inside[sample >> 6] |= bit } else { self.inside[sample >> 6] &= !bit }
    }
}

impl Grid {
    /// Index into `table` of a brick coordinate, or `None` outside the grid.
    fn slot(&self, brick: IVec3) -> Option<usize> {
        let within = brick.cmpge(IVec3::ZERO).all() && brick.cmplt(IVec3::splat(self.side)).all();
        within.then(|| (brick.x + self.side * (brick.y + self.side * brick.z)) as usize)
    }

    fn brick_of(&self, sample: IVec3) -> Option<usize> {
        let slot = self.slot(sample >> IVec3::splat(3))?;
        let index = self.table[slot];
        (index != NO_BRICK).then_some(index as usize)
    }

    fn is_inside(&self, sample: IVec3) -> bool {
        let Some(slot) = self.slot(sample >> IVec3::splat(3)) else { return false };
        match self.table[slot] {
            NO_BRICK => !self.empty_outside[slot],
            brick => self.bricks[brick as usize].is_inside(local_index(sample)),
        }
    }

    /// Signed distance to the extracted surface in cells, negative inside by distance alone; at most one.
    fn level(&self, sample: IVec3) -> f32 {
        let brick = self.brick_of(sample);
        brick.map_or(1.0, |b| (self.bricks[b].distance[local_index(sample)] - self.offset).min(1.0))
    }

    /// Whether the sample nearest to a place is inside.
    fn is_inside_at(&self, place: Vec3) -> bool {
        self.is_inside(((Vec3A::from(place) - self.origin) / self.spacing).round().as_ivec3())
    }

    /// Inside flags of a brick's samples and the first layer of the bricks after it: 9 x 9 x 9, x fastest.
    fn inside_block(&self, brick: usize) -> [bool; 729] {
        let base = self.bricks[brick].coordinate * BRICK as i32;
        let mut block = [false; 729];
        for (i, flag) in block.iter_mut().enumerate() {
            let (x, y, z) = (i % 9, i / 9 % 9, i / 81);
            *flag = if x < BRICK && y < BRICK && z < BRICK {
                self.bricks[brick].is_inside(x + BRICK * (y + BRICK * z))
            } else {
                self.is_inside(base + IVec3::new(x as i32, y as i32, z as i32))
            };
        }
        block
    }
}

/// Index of a sample within its brick.
fn local_index(sample: IVec3) -> usize {
    let l = sample & IVec3::splat(7);
    (l.x + 8 * l.y + 64 * l.z) as usize
}

/// The eight corners of a cell in the block of [`Grid::inside_block`], bit `i` for the corner at (i & 1, i >> 1 & 1, i >> 2).
fn cell_mask(block: &[bool; 729], x: usize, y: usize, z: usize) -> u8 {
    (0..8).fold(0, |mask, i| mask | u8::from(block[x + (i & 1) + 9 * (y + (i >> 1 & 1)) + 81 * (z + (i >> 2))]) << i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Topology;
    use proptest::prelude::*;

    fn wrap(mesh: &TriMesh, resolution: u32) -> TriMesh {
        let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
        reconstruct(&mesh.positions, &mesh.triangles, &bvh, &Reconstruction::new(resolution), &Cancellation::default())
    }

    fn volume(mesh: &TriMesh) -> f32 {
        (0..mesh.triangles.len()).map(|t| mesh.corners(t)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    fn cube() -> TriMesh {
        let positions = (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriMesh { positions, triangles }
    }

    #[test]
    fn a_cube_keeps_its_volume_and_is_one_closed_surface() {
        let out = wrap(&cube(), 64);
        let topology = Topology::of(&out);
        assert!(topology.is_closed_manifold(), "{topology:?}");
        assert_eq!((topology.components, topology.euler_characteristic), (1, 2));
        assert!((volume(&out) - 1.0).abs() < 0.02, "{}", volume(&out));
    }

    #[test]
    fn missing_faces_smaller_than_a_cell_are_closed_and_flipped_faces_do_not_matter() {
        let mut mesh = cube();
        mesh.triangles[0].swap(0, 1);
        mesh.triangles[5].swap(0, 1);
        let out = wrap(&mesh, 64);
        assert!(Topology::of(&out).is_closed_manifold());
        assert!((volume(&out) - 1.0).abs() < 0.02);
    }

    #[test]
    fn a_single_triangle_becomes_a_thin_closed_slab() {
        let mesh = TriMesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]] };
        let out = wrap(&mesh, 64);
        let topology = Topology::of(&out);
        assert!(topology.is_closed_manifold() && topology.euler_characteristic == 2, "{topology:?}");
        assert!(volume(&out) > 0.0 && volume(&out) < 0.01);
    }

    #[test]
    fn a_nested_cube_leaves_no_inner_surface() {
        let mut mesh = cube();
        let inner = cube();
        mesh.triangles.extend(inner.triangles.iter().map(|t| t.map(|v| v + 8)));
        mesh.positions.extend(inner.positions.iter().map(|p| *p * 0.4 + 0.3));
        assert_eq!(Topology::of(&wrap(&mesh, 64)).components, 1);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn any_soup_gives_a_closed_manifold(
            corners in prop::collection::vec((-1f32..1.0, -1f32..1.0, -1f32..1.0), 3..60),
            scale in prop::sample::select(vec![1e-6f32, 1.0, 1e6]),
        ) {
            let positions: Vec<Vec3> = corners.iter().map(|&(x, y, z)| Vec3::new(x, y, z) * scale).collect();
            let triangles: Vec<[u32; 3]> = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let topology = Topology::of(&wrap(&TriMesh { positions, triangles }, 32));
            prop_assert!(topology.is_closed_manifold(), "{:?}", topology);
        }
    }
}
