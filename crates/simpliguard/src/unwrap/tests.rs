//! Meshes and whole-stage tests.

use glam::{Quat, Vec3};
use proptest::prelude::*;

use super::*;
use crate::Cancellation;

pub(super) fn tetrahedron() -> TriMesh {
    TriMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    }
}

/// Bottom and top first, then the belt.
pub(super) fn cube() -> TriMesh {
    let positions = (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];
    TriMesh { positions, triangles: quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect() }
}

/// A closed prism over a regular polygon, its sides first.
pub(super) fn cylinder(n: u32) -> TriMesh {
    let mut mesh = TriMesh::default();
    for i in 0..n {
        let rim = Quat::from_rotation_z(std::f32::consts::TAU * i as f32 / n as f32) * Vec3::X;
        mesh.positions.extend([rim, rim + 2.0 * Vec3::Z]);
    }
    mesh.positions.extend([Vec3::ZERO, 2.0 * Vec3::Z]);
    for i in 0..n {
        let (a, b) = (2 * i, 2 * ((i + 1) % n));
        mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
    }
    for i in 0..n {
        let (a, b) = (2 * i, 2 * ((i + 1) % n));
        mesh.triangles.extend([[2 * n, b, a], [2 * n + 1, a + 1, b + 1]]);
    }
    mesh
}

/// An octahedron whose faces are quartered `steps` times, on the unit sphere.
pub(super) fn sphere(steps: usize) -> TriMesh {
    let mut mesh = TriMesh {
        positions: vec![Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z],
        triangles: vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    };
    for _ in 0..steps {
        let mut middle = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for t in std::mem::take(&mut mesh.triangles) {
            let m: [u32; 3] = std::array::from_fn(|k| {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    mesh.positions.push((mesh.positions[a as usize] + mesh.positions[b as usize]).normalize());
                    mesh.positions.len() as u32 - 1
                })
            });
            finer.extend([[t[0], m[0], m[2]], [m[0], t[1], m[1]], [m[2], m[1], t[2]], m]);
        }
        mesh.triangles = finer;
    }
    mesh
}

fn torus(n: u32, m: u32) -> TriMesh {
    let mut mesh = TriMesh::default();
    for i in 0..n {
        let around = Quat::from_rotation_z(std::f32::consts::TAU * i as f32 / n as f32);
        for j in 0..m {
            let tube = Quat::from_rotation_y(std::f32::consts::TAU * j as f32 / m as f32) * Vec3::X;
            mesh.positions.push(around * (3.0 * Vec3::X + tube));
        }
    }
    for i in 0..n {
        for j in 0..m {
            let v = |i: u32, j: u32| (i % n) * m + j % m;
            let [a, b, c, d] = [v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)];
            mesh.triangles.extend([[a, c, b], [a, d, c]]);
        }
    }
    mesh
}

/// Triangles without common vertices, from a linear congruential sequence.
fn soup(n: usize) -> TriMesh {
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let positions = (0..3 * n).map(|_| Vec3::new(next(), next(), next())).collect();
    TriMesh { positions, triangles: (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect() }
}

#[track_caller]
fn check(mesh: &TriMesh, params: &UnwrapParams) -> Atlas {
    let atlas = unwrap(mesh, None, params, &Cancellation::default());
    assert_eq!(atlas.uvs.len(), mesh.triangles.len());
    assert_eq!(atlas.chart.len(), mesh.triangles.len());
    assert!(atlas.chart.iter().all(|&c| (c as usize) < atlas.charts));
    assert!(atlas.uvs.iter().flatten().all(|p| (0.0..=1.0).contains(&p.x) && (0.0..=1.0).contains(&p.y)));
    assert_eq!(flips(&atlas), 0);
    for size in [1024, params.size] {
        assert_eq!(overlaps(&atlas, size), 0);
    }
    atlas
}

#[test]
fn an_empty_mesh_gives_an_empty_atlas() {
    let atlas = check(&TriMesh::default(), &UnwrapParams::default());
    assert_eq!((atlas.charts, atlas.stretch, atlas.fill, atlas.texels_per_unit), (0, 1.0, 0.0, 0.0));
}

#[test]
fn a_quad_is_one_isometric_chart_that_fills_the_atlas_to_its_border() {
    let mesh = TriMesh { positions: cube().positions, triangles: vec![[0, 1, 3], [0, 3, 2]] };
    let atlas = check(&mesh, &UnwrapParams { size: 256, gutter: 4 });
    assert_eq!(atlas.charts, 1);
    assert!((atlas.stretch - 1.0).abs() < 1e-6 && atlas.fill > 0.95, "{} {}", atlas.stretch, atlas.fill);
    assert!((atlas.texels_per_unit - 252.0).abs() < 2.0, "{}", atlas.texels_per_unit);
    let margin = 2.0 / 256.0;
    assert!(atlas.uvs.iter().flatten().all(|p| p.min_element() >= margin && p.max_element() <= 1.0 - margin));
}

#[test]
fn a_cube_has_at_most_six_charts_without_stretch() {
    let atlas = check(&cube(), &UnwrapParams::default());
    assert!(atlas.charts <= 6 && atlas.stretch < 1.001, "{} {}", atlas.charts, atlas.stretch);
}

#[test]
fn closed_meshes_and_handles_are_cut_into_few_charts() {
    for (mesh, most) in [(tetrahedron(), 4), (cylinder(32), 4), (sphere(3), 12), (torus(32, 16), 16)] {
        let atlas = check(&mesh, &UnwrapParams::default());
        assert!(atlas.charts <= most && atlas.stretch < 1.15, "{} {}", atlas.charts, atlas.stretch);
        assert!(atlas.fill > 0.5 || mesh.triangles.len() < 5, "{}", atlas.fill);
    }
}

#[test]
fn a_moebius_band_is_cut_where_its_sides_meet() {
    let mut mesh = TriMesh::default();
    for i in 0..16 {
        let angle = std::f32::consts::TAU * i as f32 / 16.0;
        let around = Quat::from_rotation_z(angle);
        let across = around * (Quat::from_rotation_y(0.5 * angle) * Vec3::Z);
        mesh.positions.extend([around * (2.0 * Vec3::X) - 0.5 * across, around * (2.0 * Vec3::X) + 0.5 * across]);
    }
    for i in 0..16u32 {
        let [a, b] = [2 * i, 2 * i + 1];
        let [c, d] = if i == 15 { [1, 0] } else { [2 * i + 2, 2 * i + 3] };
        mesh.triangles.extend([[a, c, b], [b, c, d]]);
    }
    let atlas = check(&mesh, &UnwrapParams::default());
    assert!(atlas.charts <= 8, "{}", atlas.charts);
}

#[test]
fn non_manifold_and_degenerate_faces_get_their_place() {
    let mut mesh = cube();
    mesh.positions.extend([Vec3::splat(3.0), Vec3::splat(3.0), Vec3::splat(f32::NAN)]);
    mesh.triangles.extend([[0, 1, 8], [1, 0, 8], [0, 0, 1], [2, 2, 2], [8, 9, 0], [0, 7, 8], [3, 4, 10]]);
    check(&mesh, &UnwrapParams::default());
}

#[test]
fn a_mesh_in_one_point_gets_its_place() {
    let mesh = TriMesh { positions: vec![Vec3::ONE; 4], triangles: tetrahedron().triangles };
    check(&mesh, &UnwrapParams::default());
}

#[test]
fn slivers_inside_a_chart_survive() {
    let mut mesh = TriMesh::default();
    for i in 0..20 {
        let x = i as f32 * 0.5 + if i % 2 == 1 { -0.4999 } else { 0.0 };
        mesh.positions.extend([Vec3::new(x, 0.0, 0.0), Vec3::new(x, 3.0, 0.0)]);
    }
    mesh.triangles = (0..19u32).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]).collect();
    assert!(check(&mesh, &UnwrapParams::default()).charts <= 3);
}

#[test]
fn a_soup_of_a_thousand_triangles_has_a_chart_each() {
    assert_eq!(check(&soup(1000), &UnwrapParams::default()).charts, 1000);
}

#[test]
fn an_atlas_too_small_for_its_gutters_still_has_no_overlap() {
    check(&soup(200), &UnwrapParams { size: 32, gutter: 4 });
    check(&sphere(3), &UnwrapParams { size: 4, gutter: 8 });
}

#[test]
fn less_important_faces_get_fewer_texels() {
    let mut mesh = cube();
    let other = cube();
    mesh.positions.extend(other.positions.iter().map(|p| *p + 5.0));
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + 8)));
    let density: Vec<f32> = (0..24).map(|f| if f < 12 { 1.0 } else { 0.25 }).collect();
    let atlas = unwrap(&mesh, Some(&density), &UnwrapParams::default(), &Cancellation::default());
    let area = |f: usize| 0.5 * (atlas.uvs[f][1] - atlas.uvs[f][0]).perp_dot(atlas.uvs[f][2] - atlas.uvs[f][0]);
    assert!((area(0) / area(12) - 16.0).abs() < 0.1, "{}", area(0) / area(12));
    let total: f32 = (0..12).map(area).sum();
    assert!(((total / 6.0).sqrt() * 1024.0 / atlas.texels_per_unit - 1.0).abs() < 1e-3);
}

#[test]
fn a_chart_far_below_a_texel_gets_the_area_of_one() {
    let mut mesh = TriMesh { positions: cube().positions, triangles: vec![[0, 1, 3], [0, 3, 2], [8, 9, 10]] };
    mesh.positions.extend([Vec3::ONE, Vec3::ONE + 1e-5 * Vec3::X, Vec3::ONE + 1e-5 * Vec3::Y]);
    for size in [128, 512] {
        let [a, b, c] = check(&mesh, &UnwrapParams { size, gutter: 2 }).uvs[2].map(|p| p * size as f32);
        assert!(0.5 * (b - a).perp_dot(c - a) > 0.99);
    }
}

#[test]
fn equal_bytes_for_one_thread_and_four() {
    let mesh = torus(24, 12);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("thread pool");
        pool.install(|| unwrap(&mesh, None, &UnwrapParams::default(), &Cancellation::default()))
    };
    assert_eq!(with(1), with(4));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn displaced_spheres_unwrap_without_overlap(offsets in prop::collection::vec(0.3f32..1.7, 258), size in 64u32..600) {
        let mut mesh = sphere(3);
        for (p, o) in mesh.positions.iter_mut().zip(&offsets) {
            *p *= *o;
        }
        check(&mesh, &UnwrapParams { size, gutter: 3 });
    }

    #[test]
    fn height_fields_unwrap_without_overlap(heights in prop::collection::vec(-1.5f32..1.5, 100)) {
        let positions = heights.iter().enumerate().map(|(i, &h)| Vec3::new((i % 10) as f32, (i / 10) as f32, h)).collect();
        let cell = |i: u32| { let v = i / 9 * 10 + i % 9; [[v, v + 1, v + 11], [v, v + 11, v + 10]] };
        check(&TriMesh { positions, triangles: (0..81).flat_map(cell).collect() }, &UnwrapParams::default());
    }

    #[test]
    fn random_faces_over_few_vertices_unwrap_without_overlap(
        positions in prop::collection::vec(prop::array::uniform3(-1f32..1.0), 12),
        triangles in prop::collection::vec(prop::array::uniform3(0u32..12), 1..60),
    ) {
        let positions = positions.into_iter().map(Vec3::from).collect();
        check(&TriMesh { positions, triangles }, &UnwrapParams { size: 256, gutter: 4 });
    }
}
