use super::*;
use crate::mesh::Topology;
use proptest::prelude::*;

fn grid(n: u32, height: impl Fn(f32, f32) -> f32) -> TriMesh {
    let at = |i: u32| i as f32 / n as f32;
    let positions = (0..(n + 1) * (n + 1))
        .map(|i| (at(i % (n + 1)), at(i / (n + 1))))
        .map(|(x, y)| Vec3::new(x, y, height(x, y)))
        .collect();
    let triangles = (0..n * n)
        .flat_map(|i| {
            let a = i / n * (n + 1) + i % n;
            [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
        })
        .collect();
    TriMesh { positions, triangles }
}

fn areas(mesh: &TriMesh) -> Vec<f64> {
    (0..mesh.triangles.len()).map(|t| f64::from(mesh.area_vector(t).length()) * 0.5).collect()
}

fn simplified(mesh: &TriMesh, target: usize) -> TriMesh {
    let mut simplifier = Simplifier::new(mesh, &areas(mesh), 0.0);
    simplifier.run(target);
    simplifier.mesh()
}

#[test]
fn a_flat_square_collapses_to_two_faces_with_its_corners_in_place() {
    let out = simplified(&grid(8, |_, _| 0.0), 2);
    assert_eq!(out.triangles.len(), 2);
    let area: f32 = (0..2).map(|t| out.area_vector(t).length() * 0.5).sum();
    assert!((area - 1.0).abs() < 1e-5, "{area}");
}

#[test]
fn a_crease_keeps_its_ridge() {
    let out = simplified(&grid(8, |x, _| if x < 0.5 { x } else { 1.0 - x }), 4);
    assert!(out.triangles.len() <= 4);
    assert!((out.bounds().1.z - 0.5).abs() < 1e-4, "{:?}", out.bounds());
}

#[test]
fn a_tetrahedron_stays_within_its_budget_and_vanishes_below_it() {
    let mesh = TriMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    };
    assert_eq!(simplified(&mesh, 4).triangles.len(), 4);
    assert_eq!(simplified(&mesh, 3).triangles.len(), 0);
}

#[test]
fn a_hole_of_three_edges_closes() {
    // An octahedron without one face.
    let mesh = TriMesh {
        positions: vec![Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z],
        triangles: vec![[2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    };
    let out = simplified(&mesh, 6);
    let topology = Topology::of(&out);
    assert!(topology.is_manifold() && out.triangles.len() <= 6, "{topology:?}");
}

#[test]
fn the_smallest_component_vanishes_first() {
    let mut mesh = TriMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    };
    let small: Vec<Vec3> = mesh.positions.iter().map(|p| *p * 0.1 + 3.0).collect();
    mesh.positions.extend(small);
    let copies: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| v + 4)).collect();
    mesh.triangles.extend(copies);
    let out = simplified(&mesh, 4);
    assert_eq!(out.triangles.len(), 4);
    assert!(out.bounds().1.max_element() < 2.0, "the large one stays");
}

#[test]
fn removing_faces_leaves_no_pinched_vertex() {
    let mesh = grid(2, |_, _| 0.0);
    let mut simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.0);
    // Two opposite quadrants go: the centre would join the others at a point.
    simplifier.remove_faces(&[true, true, false, false, false, false, true, true]);
    let topology = Topology::of(&simplifier.mesh());
    assert_eq!((topology.non_manifold_vertices, topology.components), (0, 2));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn height_fields_stay_manifold_within_budget(
        heights in prop::collection::vec(-0.3f32..0.3, 121), target in 4usize..150,
    ) {
        let mesh = grid(10, |x, y| heights[((y * 10.0).round() * 11.0 + (x * 10.0).round()) as usize]);
        let out = simplified(&mesh, target);
        let topology = Topology::of(&out);
        prop_assert!(topology.is_manifold() && topology.degenerate == 0, "{:?}", topology);
        prop_assert!(out.triangles.len() <= target && out.triangles.len() + 2 >= target.min(200));
    }
}
