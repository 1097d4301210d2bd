use super::simplifier::Simplifier;
use crate::animation::Motions;
use crate::data::TriMesh;
use crate::geometry::{Topology, self_intersecting};
use glam::{Affine3A, Vec3};
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
fn strips_along_a_boundary_are_at_most_a_tenth_of_their_component() {
    let mut ribbon = grid(10, |_, _| 0.0);
    ribbon.positions.iter_mut().for_each(|p| p.y *= 0.02);
    for (mesh, width) in [(grid(10, |_, _| 0.0), 0.025), (ribbon, 0.1 * 0.02 / 2.04)] {
        let simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.0);
        let strips = simplifier.boundary_strips(&simplifier.boundary_edges());
        assert_eq!(strips.len(), 40);
        strips.iter().for_each(|strip| assert!((strip - width).abs() < 1e-6, "{strip} {width}"));
    }
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
fn what_is_left_collapses_as_if_nothing_had_been_dropped() {
    let mesh = grid(24, |x, y| 0.2 * libm::sinf(5.0 * x) * libm::sinf(7.0 * y));
    let mut simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.1);
    simplifier.run(300);
    let mut compact = simplifier.clone();
    compact.compact();
    assert_eq!((compact.faces.len(), compact.faces()), (simplifier.faces(), simplifier.faces()));
    for target in [300, 120, 12] {
        simplifier.run(target);
        compact.run(target);
        assert_eq!(compact.mesh(), simplifier.mesh());
    }
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
    // Two opposite quadrants are removed: the others share only the centre.
    simplifier.remove_faces(&[true, true, false, false, false, false, true, true]);
    let topology = Topology::of(&simplifier.mesh());
    assert_eq!((topology.non_manifold_vertices, topology.components), (0, 2));
}

#[test]
fn the_rim_of_removed_faces_does_not_slide() {
    let half = |remove: bool| {
        let mesh = grid(8, |_, _| 0.0);
        let mut simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.0);
        if remove {
            // The rows of quads from the middle on.
            simplifier.remove_faces(&(0..128).map(|t| t >= 64).collect::<Vec<_>>());
        }
        simplifier.run(2);
        simplifier.mesh()
    };
    let (_, top) = half(true).bounds();
    assert!((top.y - 0.5).abs() < 1e-4 && (top.x - 1.0).abs() < 1e-4, "{top}");
    assert!((half(false).bounds().1.y - 1.0).abs() < 1e-4);
}

/// Two rippled sheets, the upper a hair above the lower. If they collapse freely, their faces intersect.
fn two_sheets() -> TriMesh {
    let ripple = |x: f32, y: f32| 0.05 * (libm::sinf(9.0 * x) + libm::cosf(7.0 * y));
    let (mut mesh, upper) = (grid(16, ripple), grid(16, |x, y| ripple(x, y) + 0.002 + 0.008 * x * y));
    mesh.triangles.extend(upper.triangles.iter().map(|t| t.map(|v| v + mesh.positions.len() as u32)));
    mesh.positions.extend(upper.positions);
    mesh
}

#[test]
fn close_sheets_do_not_grow_through_each_other_once_watched() {
    let mesh = two_sheets();
    let self_intersecting = |watch: bool| {
        let mut simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.0);
        if watch {
            simplifier.watch_intersections();
        }
        simplifier.run(300);
        let out = simplifier.mesh();
        assert!(out.triangles.len() <= 300 && !simplifier.is_stuck());
        self_intersecting(&out).into_iter().filter(|face| *face).count()
    };
    assert_eq!(self_intersecting(true), 0);
    assert!(self_intersecting(false) > 0, "the test would pass without the watch");
}

#[test]
fn a_budget_is_met_where_collapses_would_cross() {
    let mesh = two_sheets();
    let mut simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.0);
    simplifier.watch_intersections();
    assert!(simplifier.run(4) <= 4);
    assert!(Topology::of(&simplifier.mesh()).is_manifold());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn height_fields_never_intersect_themselves(
        heights in prop::collection::vec(-0.3f32..0.3, 121), target in 40usize..150,
    ) {
        let mesh = grid(10, |x, y| heights[((y * 10.0).round() * 11.0 + (x * 10.0).round()) as usize]);
        let mut simplifier = Simplifier::new(&mesh, &areas(&mesh), 0.0);
        simplifier.watch_intersections();
        simplifier.run(target);
        prop_assert!(!self_intersecting(&simplifier.mesh()).contains(&true));
    }

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

#[test]
fn an_edge_that_only_bends_in_motion_is_kept() {
    let mut simplifier = Simplifier::new(&grid(8, |_, _| 0.0), &areas(&grid(8, |_, _| 0.0)), 0.0);
    // A square in the rest pose. In motion the half beyond x = 1/2 is rotated up about that line.
    simplifier.follow(1, |positions| {
        let turn = |p: &Vec3| {
            let turn = if p.x > 0.5 { Affine3A::from_rotation_y(-1.0) } else { Affine3A::IDENTITY };
            Affine3A::from_translation(Vec3::X * 0.5) * turn * Affine3A::from_translation(Vec3::X * -0.5)
        };
        Motions::new(vec![positions.iter().map(turn).collect()])
    });
    assert_eq!(simplifier.run(6), 6);
    let mesh = simplifier.mesh();
    let on_hinge = mesh.positions.iter().filter(|p| (p.x - 0.5).abs() < 1e-6).count();
    assert!(on_hinge >= 2, "{:?}", mesh.positions);
    let crosses = |t: usize| {
        let x = mesh.corners(t).map(|p| p.x - 0.5);
        x.iter().any(|x| *x > 1e-6) && x.iter().any(|x| *x < -1e-6)
    };
    assert!((0..6).all(|t| !crosses(t)), "{mesh:?}");
}

/// A square plate with `n` x `n` square holes, closed on all sides.
fn lattice(n: u32, offset: Vec3) -> TriMesh {
    let (side, mut mesh) = (2 * n + 1, TriMesh::default());
    let is_solid = |x: i32, y: i32| {
        let within = (0..side as i32).contains(&x) && (0..side as i32).contains(&y);
        within && (x % 2 == 0 || y % 2 == 0)
    };
    let at = |x: u32, y: u32, z: u32| (z * (side + 1) + y) * (side + 1) + x;
    for z in 0..2 {
        for y in 0..=side {
            mesh.positions.extend((0..=side).map(|x| offset + Vec3::new(x as f32, y as f32, 0.5 * z as f32) / 20.0));
        }
    }
    let mut quad = |[a, b, c, d]: [u32; 4]| mesh.triangles.extend([[a, b, c], [a, c, d]]);
    for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
        if !is_solid(x as i32, y as i32) {
            continue;
        }
        quad([at(x, y, 1), at(x + 1, y, 1), at(x + 1, y + 1, 1), at(x, y + 1, 1)]);
        quad([at(x, y, 0), at(x, y + 1, 0), at(x + 1, y + 1, 0), at(x + 1, y, 0)]);
        let corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)];
        let beyond = [(0, -1), (1, 0), (0, 1), (-1, 0)];
        for (k, (dx, dy)) in beyond.into_iter().enumerate() {
            if !is_solid(x as i32 + dx, y as i32 + dy) {
                let ((ax, ay), (bx, by)) = (corners[k], corners[(k + 1) % 4]);
                quad([at(ax, ay, 0), at(bx, by, 0), at(bx, by, 1), at(ax, ay, 1)]);
            }
        }
    }
    mesh
}

#[test]
fn a_lattice_gives_way_to_what_weighs_more() {
    let mut mesh = grid(10, |x, y| 0.3 * (x * 3.0).sin() * (y * 3.0).cos());
    let sheet = areas(&mesh).len();
    mesh.append(&lattice(6, Vec3::new(0.0, 0.0, 2.0)));
    let weights: Vec<f64> =
        (areas(&mesh).into_iter().enumerate()).map(|(i, a)| if i < sheet { 10.0 * a } else { a }).collect();
    let simplifier = Simplifier::new(&mesh, &weights, 0.0);

    // Each of the 36 holes needs faces around it.
    let mut blocked = simplifier.clone();
    blocked.run(100);
    assert!(blocked.is_exhausted());
    let mut freed = simplifier.without_blocking_components(100).expect("the lattice blocks");
    assert_eq!(freed.faces(), sheet);
    assert!(freed.run(100) <= 100 && !freed.is_exhausted());
    assert!(simplifier.without_blocking_components(mesh.triangles.len()).is_none());
}
