//! Welds a triangle soup and cuts it into a manifold with boundary.

use std::collections::HashMap;

use glam::Vec3;

use crate::data::{TriMesh, bounds};
use crate::geometry::{DisjointSets, Topology, first_equal, position_bits};

/// Positions closer than this fraction of the longest side become one.
const WELD: f32 = 1e-6;
/// Rounds of cutting; each one removes at least the edges it finds.
const ROUNDS: usize = 8;

/// The soup's triangles, sharing vertices where their corners coincide, cut apart along edges of more than two triangles
/// or of two that run the same way, and at pinched vertices. `source` maps each triangle back; degenerate ones are gone.
pub(super) fn weld(positions: &[Vec3], triangles: &[[u32; 3]]) -> (TriMesh, Vec<u32>) {
    let (low, high) = bounds(positions);
    let cell = ((high - low).max_element() * WELD).max(f32::MIN_POSITIVE);
    let mut ids: HashMap<[i64; 3], u32> = HashMap::with_capacity(positions.len());
    let mut merged = Vec::new();
    let welded: Vec<u32> = positions
        .iter()
        .map(|&p| {
            let key = ((p - low) / cell).to_array().map(|c| c.round() as i64);
            *ids.entry(key).or_insert_with(|| {
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
    (cut(&mesh), source)
}

/// Cuts a mesh into a manifold with boundary, keeping the order of its triangles.
pub(super) fn cut(mesh: &TriMesh) -> TriMesh {
    let mut out = cut_once(mesh, &|_| true);
    for _ in 0..ROUNDS {
        if Topology::of(&out).is_manifold() {
            break;
        }
        // Two pairs on one edge whose fans meet at both ends: keep those edges apart altogether.
        let bad = overfull_edges(&out);
        out = cut_once(&out, &|edge| !bad.contains(&edge));
    }
    out
}

/// Moves vertices that share a place by `step` towards their neighbours, if welding them would make the mesh
/// non-manifold: tools that weld by position then see what is stored.
pub(super) fn part_coincident(mesh: &mut TriMesh, step: f32) {
    let first = first_equal(mesh.positions.len(), |v| position_bits(mesh.positions[v]));
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

fn overfull_edges(mesh: &TriMesh) -> std::collections::HashSet<(u32, u32)> {
    let mut count: HashMap<(u32, u32), (u32, u32)> = HashMap::new();
    for triangle in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            let entry = count.entry((a.min(b), a.max(b))).or_default();
            if a < b { entry.0 += 1 } else { entry.1 += 1 }
        }
    }
    count.into_iter().filter(|(_, n)| n.0 > 1 || n.1 > 1).map(|(edge, _)| edge).collect()
}

/// Pairs the two directions of every edge that `joins`, in the order of their triangles, and joins corners across pairs:
/// each fan becomes a vertex.
fn cut_once(mesh: &TriMesh, joins: &dyn Fn((u32, u32)) -> bool) -> TriMesh {
    let mut half_edges: Vec<((u32, u32), bool, u32)> = Vec::with_capacity(mesh.triangles.len() * 3);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            half_edges.push(((a.min(b), a.max(b)), a < b, (3 * t + k) as u32));
        }
    }
    half_edges.sort_unstable();
    let mut corners = DisjointSets::new(mesh.triangles.len() * 3);
    for run in half_edges.chunk_by(|a, b| a.0 == b.0) {
        if !joins(run[0].0) {
            continue;
        }
        let split = run.partition_point(|h| !h.1);
        for (back, forth) in run[..split].iter().zip(&run[split..]) {
            let after = |corner: u32| corner - corner % 3 + (corner + 1) % 3;
            corners.join(back.2 as usize, after(forth.2) as usize);
            corners.join(after(back.2) as usize, forth.2 as usize);
        }
    }
    let mut out = TriMesh { positions: Vec::new(), triangles: vec![[0; 3]; mesh.triangles.len()] };
    let mut vertex = vec![u32::MAX; mesh.triangles.len() * 3];
    for corner in 0..vertex.len() {
        let root = corners.find(corner);
        if vertex[root] == u32::MAX {
            vertex[root] = out.positions.len() as u32;
            out.positions.push(mesh.positions[mesh.triangles[corner / 3][corner % 3] as usize]);
        }
        out.triangles[corner / 3][corner % 3] = vertex[root];
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
        part_coincident(&mut touching, 1e-3);
        assert!(touching.positions[..3] == before.positions[..3] && touching.positions[3] != touching.positions[0]);
        assert!((touching.positions[3] - before.positions[3]).length() < 1.1e-3);
        let mut seam =
            TriMesh { positions: [&x[..], &[Vec3::Y], &x, &[Vec3::Z]].concat(), triangles: vec![[0, 1, 2], [4, 3, 5]] };
        let before = seam.clone();
        part_coincident(&mut seam, 1e-3);
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
