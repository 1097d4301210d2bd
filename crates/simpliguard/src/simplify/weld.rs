//! Welds a triangle soup and cuts it into a manifold with boundary.

use std::collections::{HashMap, HashSet};

use glam::Vec3;

use super::stitch::stitched;
use crate::data::{TriMesh, bounds};
use crate::geometry::{DisjointSets, Topology, first_coincident, sorted_half_edges};

/// Distance by which coincident vertices are moved apart, as a fraction of the radius of the bounding sphere.
pub(super) const COINCIDENT_OFFSET: f32 = 2e-5;

/// Size of the cells in which positions are merged, as a fraction of the longest side of the bounding box.
const WELD: f32 = 1e-6;
/// Most rounds of cutting. Each round removes at least the non-manifold edges that it finds.
const ROUNDS: usize = 8;

/// Welds the soup's triangles where their corners coincide, and cuts them apart along edges of more than two triangles,
/// along edges of two triangles with opposite windings, and at pinched vertices. Returns the mesh, and for each of its
/// triangles the index in the soup; degenerate triangles are left out.
pub(super) fn weld(positions: &[Vec3], triangles: &[[u32; 3]]) -> (TriMesh, Vec<u32>) {
    let (mesh, source) = merged(positions, triangles);
    (cut(&mesh), source)
}

/// Does the same as [`weld`], and joins the boundaries of patches that nearly meet. A collapse then opens no gap between them.
pub(super) fn weld_patches(positions: &[Vec3], triangles: &[[u32; 3]]) -> (TriMesh, Vec<u32>) {
    let (mut mesh, source) = merged(positions, triangles);
    let replaced_by = stitched(&mesh.positions, &mesh.triangles);
    for corner in mesh.triangles.iter_mut().flatten() {
        *corner = replaced_by[*corner as usize];
    }
    (cut(&mesh), source)
}

/// The triangles with one vertex for each place, without degenerate ones, and for each its index in the soup.
fn merged(positions: &[Vec3], triangles: &[[u32; 3]]) -> (TriMesh, Vec<u32>) {
    let place = places(positions);
    let mut ids: HashMap<[i64; 3], u32> = HashMap::with_capacity(positions.len());
    let mut merged = Vec::new();
    let welded: Vec<u32> = positions
        .iter()
        .map(|&p| {
            *ids.entry(place(p)).or_insert_with(|| {
                merged.push(p);
                merged.len() as u32 - 1
            })
        })
        .collect();
    let mut mesh = TriMesh { positions: merged, triangles: Vec::with_capacity(triangles.len()) };
    let mut source = Vec::with_capacity(triangles.len());
    for (t, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| welded[v as usize]);
        if a != b && b != c && c != a {
            mesh.triangles.push([a, b, c]);
            source.push(t as u32);
        }
    }
    (mesh, source)
}

/// The place of each point among `positions`: those of one place are merged.
pub(super) fn places(positions: &[Vec3]) -> impl Fn(Vec3) -> [i64; 3] + use<> {
    let (low, high) = bounds(positions);
    let cell = ((high - low).max_element() * WELD).max(f32::MIN_POSITIVE);
    move |p| ((p - low) / cell).to_array().map(|c| c.round() as i64)
}

/// Cuts a mesh into a manifold with boundary. The order of its triangles stays.
pub(super) fn cut(mesh: &TriMesh) -> TriMesh {
    let mut out = cut_once(mesh, &|_| true);
    for _ in 0..ROUNDS {
        if Topology::of(&out).is_manifold() {
            break;
        }
        // Two pairs of triangles on one edge, whose fans meet at both ends of it: such an edge is cut altogether.
        let overfull = overfull_edges(&out);
        out = cut_once(&out, &|edge| !overfull.contains(&edge));
    }
    out
}

/// Moves vertices that share a position by `step` towards their neighbours, if welding them would make the mesh
/// non-manifold. So tools that weld by position see the mesh that is stored.
pub(super) fn move_coincident_apart(mesh: &mut TriMesh, step: f32) {
    let first = first_coincident(&mesh.positions);
    let welded = TriMesh {
        positions: mesh.positions.clone(),
        triangles: mesh.triangles.iter().map(|t| t.map(|v| first[v as usize])).collect(),
    };
    if Topology::of(&welded).is_manifold() {
        return;
    }
    let mut around = vec![(Vec3::ZERO, 0.0); mesh.positions.len()];
    for triangle in &mesh.triangles {
        let sum: Vec3 = triangle.iter().map(|&v| mesh.positions[v as usize]).sum();
        for &v in triangle {
            around[v as usize].0 += sum;
            around[v as usize].1 += 3.0;
        }
    }
    for (v, p) in mesh.positions.iter_mut().enumerate().filter(|(v, _)| first[*v] != *v as u32) {
        let (sum, count) = around[v];
        *p += (sum / f32::max(count, 1.0) - *p).normalize_or(Vec3::Y) * step;
    }
}

/// The edges with more than one half-edge of one direction.
fn overfull_edges(mesh: &TriMesh) -> HashSet<(u32, u32)> {
    let half_edges = sorted_half_edges(&mesh.triangles);
    let repeated = half_edges.windows(2).filter(|h| h[0].edge == h[1].edge && h[0].forward == h[1].forward);
    repeated.map(|h| h[0].edge).collect()
}

/// Pairs half-edges of opposite directions on every edge for which `joins` holds, in the order of their triangles, and
/// joins corners across the pairs. Each set of joined corners becomes a vertex.
fn cut_once(mesh: &TriMesh, joins: &dyn Fn((u32, u32)) -> bool) -> TriMesh {
    let half_edges = sorted_half_edges(&mesh.triangles);
    let mut corners = DisjointSets::new(mesh.triangles.len() * 3);
    for run in half_edges.chunk_by(|a, b| a.edge == b.edge).filter(|run| joins(run[0].edge)) {
        let (backward, forward) = run.split_at(run.partition_point(|h| !h.forward));
        for (back, forth) in backward.iter().zip(forward) {
            let after = |corner: u32| corner - corner % 3 + (corner + 1) % 3;
            corners.join(back.index as usize, after(forth.index) as usize);
            corners.join(after(back.index) as usize, forth.index as usize);
        }
    }
    let (vertices, count) = corners.numbered();
    let mut out = TriMesh { positions: Vec::with_capacity(count), triangles: vec![[0; 3]; mesh.triangles.len()] };
    for (corner, &vertex) in vertices.iter().enumerate() {
        // Vertices are numbered by their first corners.
        if vertex as usize == out.positions.len() {
            out.positions.push(mesh.positions[mesh.triangles[corner / 3][corner % 3] as usize]);
        }
        out.triangles[corner / 3][corner % 3] = vertex;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn coincident_corners_are_joined() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        let (mesh, source) = weld(&positions, &[[0, 1, 2], [3, 4, 5], [0, 1, 3]]);
        assert_eq!((mesh.positions.len(), source), (4, vec![0, 1]));
    }

    #[test]
    fn three_fins_on_an_edge_are_cut_to_a_pair_and_a_single() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Y];
        let (mesh, _) = weld(&positions, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        let topology = Topology::of(&mesh);
        assert!(topology.is_manifold(), "{topology:?}");
        assert_eq!(topology.components, 2);
    }

    #[test]
    fn two_tetrahedra_at_one_edge_come_apart() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Y, -Vec3::Z];
        let opaque = |c, d| [[0, c, 1], [0, 1, d], [0, d, c], [1, c, d]];
        let triangles: Vec<[u32; 3]> = [opaque(2, 3), opaque(4, 5)].concat();
        let (mesh, _) = weld(&positions, &triangles);
        assert!(Topology::of(&mesh).is_manifold(), "{:?}", Topology::of(&mesh));
    }

    #[test]
    fn sheets_that_touch_along_an_edge_are_parted_and_others_left_alone() {
        let x = [Vec3::ZERO, Vec3::X];
        let mut touching = TriMesh {
            positions: [&x[..], &[Vec3::Y], &x, &[Vec3::Z], &x, &[-Vec3::Y]].concat(),
            triangles: vec![[0, 1, 2], [3, 4, 5], [6, 7, 8]],
        };
        let before = touching.clone();
        move_coincident_apart(&mut touching, 1e-3);
        assert!(touching.positions[..3] == before.positions[..3] && touching.positions[3] != touching.positions[0]);
        assert!((touching.positions[3] - before.positions[3]).length() < 1.1e-3);
        let mut seam =
            TriMesh { positions: [&x[..], &[Vec3::Y], &x, &[Vec3::Z]].concat(), triangles: vec![[0, 1, 2], [4, 3, 5]] };
        let before = seam.clone();
        move_coincident_apart(&mut seam, 1e-3);
        assert_eq!(seam, before);
    }

    #[test]
    fn opposite_windings_are_cut_apart() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)];
        let (mesh, _) = weld(&positions, &[[0, 1, 2], [1, 2, 3]]);
        assert_eq!(Topology::of(&mesh).edges.boundary, 6);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        /// Few places for many corners: fins, copies, flipped copies, fans that touch, faces without area.
        #[test]
        fn any_soup_is_cut_into_a_manifold_that_stays_one(
            places in prop::collection::vec((-2i8..3, -2i8..3, -2i8..3), 4..12),
            corners in prop::collection::vec(0usize..144, 3..120),
            scale in prop::sample::select(vec![1e-5f32, 1.0, 1e6]),
        ) {
            let positions: Vec<Vec3> =
                places.iter().map(|&(x, y, z)| Vec3::new(x.into(), y.into(), z.into()) * scale).collect();
            let index = |c: usize| (c % positions.len()) as u32;
            let triangles: Vec<[u32; 3]> =
                corners.chunks_exact(3).map(|c| [index(c[0]), index(c[1]), index(c[2])]).collect();
            let (mesh, source) = weld(&positions, &triangles);
            prop_assert!(Topology::of(&mesh).is_manifold(), "{:?}", Topology::of(&mesh));
            prop_assert_eq!(mesh.triangles.len(), source.len());
            let target = mesh.triangles.len() / 2;
            let out = crate::simplify::collapse(&mesh, target.max(4));
            prop_assert!(Topology::of(&out).is_manifold(), "{:?}", Topology::of(&out));
        }
    }
}
