//! A watertight manifold around any triangle soup.
//!
//! 1. Sample the unsigned distance to the source in a narrow band, in sparse bricks of 8 x 8 x 8 samples that an octree
//!    descent finds (`field`, `grid`).
//! 2. Flood the outside from a corner of the grid, and from points known to be free, through the samples farther than `offset` from the surface
//!    (`flood`). Every edge of the grid that crosses the source has an end within half a cell of it, so nothing leaks
//!    if `offset` is above one half. Holes narrower than about two offsets close.
//! 3. Add samples to the inside until no 2 x 2 face and no cell is connected across a diagonal only (`repair`;
//!    well-composed sets, Latecki 1997). The boundary is then a 2-manifold, and one vertex per cell is enough.
//! 4. Place one vertex in each boundary cell (`nets`; surface nets, Gibson 1998) and pull each vertex back onto the
//!    source (`pull`).
//!
//! Open sheets become slabs of twice the offset, which are pulled back to a tenth of a cell. Solids, however thin, are
//! pulled back almost onto their surface. Parts thinner than a cell are kept. After the pull, the mesh may be
//! self-intersecting where two sheets lie within a cell.

mod field;
mod flood;
mod grid;
mod nets;
mod pull;
mod repair;
mod triangle;

use glam::Vec3;

use crate::Cancellation;
use crate::data::{Reconstruction, TriMesh};
use crate::geometry::Bvh;

/// Wraps the triangles of `mesh`, which `bvh` holds as well. Space around the `free` points is outside even if the mesh
/// encloses it. The result is empty for an empty mesh and empty or unfinished if cancelled.
pub fn reconstruct(
    mesh: &TriMesh,
    bvh: &Bvh,
    free: &[Vec3],
    params: &Reconstruction,
    cancellation: &Cancellation,
) -> TriMesh {
    if mesh.triangles.is_empty() {
        return TriMesh::default();
    }
    let mut grid = field::build(mesh, params, cancellation);
    if cancellation.is_cancelled() {
        return TriMesh::default();
    }
    flood::mark_inside(&mut grid, free);
    repair::make_well_composed(&mut grid);
    if cancellation.is_cancelled() {
        return TriMesh::default();
    }
    let mut wrapped = nets::extract(&grid);
    pull::pull_back(&mut wrapped, &grid, bvh, params.keep, cancellation);
    wrapped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Topology;
    use proptest::prelude::*;

    fn wrap(mesh: &TriMesh, resolution: u32) -> TriMesh {
        let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
        reconstruct(mesh, &bvh, &[], &Reconstruction::new(resolution), &Cancellation::default())
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
    fn a_cube_whose_middle_is_free_is_a_shell() {
        let (mesh, cancellation) = (cube(), Cancellation::default());
        let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
        let out = reconstruct(&mesh, &bvh, &[Vec3::splat(0.5)], &Reconstruction::new(64), &cancellation);
        let topology = Topology::of(&out);
        assert!(topology.is_closed_manifold(), "{topology:?}");
        assert_eq!((topology.components, topology.euler_characteristic), (2, 4));
        assert!(volume(&out) > 0.0 && volume(&out) < 0.1, "{}", volume(&out));
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
