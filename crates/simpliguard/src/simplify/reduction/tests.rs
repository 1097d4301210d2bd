//! Tests of whole reductions.

use glam::{Affine2, Vec2, Vec3, Vec4};
use image::RgbaImage;
use proptest::prelude::*;

use super::*;
use crate::Cancellation;
use crate::data::{AlphaMode, Material, Model, Surface, Texture, TextureRef, Wrap};
use crate::geometry::{Topology, first_coincident};
use crate::simplify::CollapseParams;

const PARAMS: CollapseParams = CollapseParams {
    remove_invisible: true,
    visible_weight: 0.5,
    curvature: 0.0,
    curvature_angle: None,
    invisible_rays: 0,
    split_at_joints: false,
};

fn reduced(model: &Model, budget: u32) -> Surface {
    let cancellation = Cancellation::default();
    let inputs = ReductionInputs { model, poses: None, importance: None, params: &PARAMS, cancellation: &cancellation };
    let surface = reduce(&inputs, &[budget]).pop().flatten().expect("faces").surface;
    assert!(surface.triangles.len() <= budget as usize);
    let topology = Topology::of(&welded(&surface));
    assert!(topology.is_manifold() && topology.degenerate == 0, "{topology:?}");
    surface
}

/// The surface as tools see it that join vertices by position.
fn welded(surface: &Surface) -> TriMesh {
    let first = first_coincident(&surface.positions);
    let triangles = surface.triangles.iter().map(|t| t.map(|v| first[v as usize])).collect();
    TriMesh { positions: surface.positions.clone(), triangles }
}

/// A square of `n` x `n` quads over the unit square, at the heights of a function. Texture coordinates are x and y.
fn grid(n: u32, height: impl Fn(f32, f32) -> f32) -> Surface {
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let places: Vec<Vec2> =
        (0..=n).flat_map(|y| (0..=n).map(move |x| Vec2::new(x as f32, y as f32) / n as f32)).collect();
    let quad = |(x, y): (u32, u32)| {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        [[a, b, c], [a, c, d]]
    };
    let triangles: Vec<[u32; 3]> = (0..n).flat_map(|y| (0..n).map(move |x| (x, y))).flat_map(quad).collect();
    let positions: Vec<Vec3> = places.iter().map(|p| p.extend(height(p.x, p.y))).collect();
    let normals = TriMesh { positions: positions.clone(), triangles: triangles.clone() }.vertex_normals();
    let material = vec![0; triangles.len()];
    Surface { positions, normals, uvs: [places, Vec::new()], triangles, material, ..Surface::default() }
}

/// A two-sided model with a texture of so many texels a side.
fn textured(surface: Surface, texels: u32) -> Model {
    let texture = TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY };
    let material = Material { base_color_texture: Some(texture), double_sided: true, ..Material::default() };
    let count = surface.material.iter().max().map_or(0, |&last| last as usize + 1);
    let textures = vec![Texture::new(&RgbaImage::new(texels, texels), [Wrap::Repeat; 2], true)];
    Model { surface, materials: vec![material; count], textures, ..Model::empty("model") }
}

/// The texture coordinate of each corner, with its position.
fn corners(surface: &Surface) -> impl Iterator<Item = (Vec3, Vec2)> {
    surface.triangles.iter().flatten().map(|&v| (surface.positions[v as usize], surface.uvs[0][v as usize]))
}

#[test]
fn a_flat_square_needs_two_triangles_and_keeps_its_texture() {
    let surface = reduced(&textured(grid(8, |_, _| 0.0), 64), 2);
    assert_eq!(surface.triangles.len(), 2);
    assert!((welded(&surface).area() - 1.0).abs() < 1e-6);
    assert!(corners(&surface).all(|(p, uv)| p.truncate() == uv && p.z == 0.0));
}

#[test]
fn a_source_within_the_budget_stays_as_it_is() {
    let model = textured(grid(4, |x, y| x * y), 64);
    let surface = reduced(&model, 32);
    assert_eq!(surface.triangles.len(), 32);
    let of = |surface: &Surface| corners(surface).collect::<Vec<_>>();
    assert_eq!(of(&surface), of(&model.surface));
}

#[test]
fn textures_on_both_sides_of_a_seam_stay_where_they_are() {
    // The right half repeats the left one's texture.
    let mut left = grid(8, |_, _| 0.0);
    left.uvs[0].iter_mut().for_each(|uv| uv.x *= 0.5);
    let mut surface = left.clone();
    let count = left.positions.len() as u32;
    surface.positions.extend(left.positions.iter().map(|p| *p + Vec3::X));
    surface.normals.extend(left.normals);
    surface.uvs[0].extend(left.uvs[0].clone());
    surface.triangles.extend(left.triangles.iter().map(|t| t.map(|v| v + count)));
    surface.material.extend(left.material);
    let surface = reduced(&textured(surface, 64), 4);
    assert_eq!(surface.triangles.len(), 4);
    for t in &surface.triangles {
        let middle = t.iter().map(|&v| surface.positions[v as usize].x).sum::<f32>() / 3.0;
        let start = if middle > 1.0 { 1.0 } else { 0.0 };
        for &v in t {
            let (p, uv) = (surface.positions[v as usize], surface.uvs[0][v as usize]);
            assert!((uv - Vec2::new(0.5 * (p.x - start), p.y)).length() < 1e-5, "{p} {uv}");
        }
    }
}

#[test]
fn colours_of_a_palette_stay_apart() {
    let mut surface = grid(8, |_, _| 0.0);
    // Faces have vertices of their own, and those of the upper half another colour.
    let corners = surface.triangles.as_flattened().to_vec();
    let triangles = (0..surface.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    surface = Surface { material: surface.material.clone(), triangles, ..surface.gathered(&corners) };
    for t in &surface.triangles {
        let upper = t.iter().all(|&v| surface.positions[v as usize].y >= 0.5);
        t.iter().for_each(|&v| surface.uvs[0][v as usize] = Vec2::splat(if upper { 0.75 } else { 0.25 }));
    }
    let surface = reduced(&textured(surface, 4), 4);
    let area = |upper: bool| {
        let of_color = |t: &&[u32; 3]| t.iter().all(|&v| (surface.uvs[0][v as usize].x > 0.5) == upper);
        let triangles = surface.triangles.iter().filter(of_color).copied().collect();
        TriMesh { positions: surface.positions.clone(), triangles }.area()
    };
    assert!((area(true) - 0.5).abs() < 1e-4 && (area(false) - 0.5).abs() < 1e-4, "{} {}", area(true), area(false));
}

#[test]
fn materials_keep_their_faces_and_clear_ones_come_last() {
    let mut surface = grid(4, |_, _| 0.0);
    let left = |t: &[u32; 3]| t.iter().map(|&v| surface.positions[v as usize].x).sum::<f32>() < 1.5;
    surface.material = surface.triangles.iter().map(|t| u32::from(!left(t))).collect();
    let mut model = textured(surface, 64);
    model.materials[0].alpha_mode = AlphaMode::Blend;
    let surface = reduced(&model, 4);
    assert_eq!(surface.material, [1, 1, 0, 0]);
    let area = |range: std::ops::Range<usize>| {
        let triangles = surface.triangles[range].to_vec();
        TriMesh { positions: surface.positions.clone(), triangles }.area()
    };
    assert!((area(0..2) - 0.5).abs() < 1e-4 && (area(2..4) - 0.5).abs() < 1e-4);
}

/// A closed box of 12 flat-shaded triangles.
fn cube(side: f32, centre: Vec3) -> Surface {
    let mut out = Surface::default();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
        let (u, first) = (axis.any_orthonormal_vector(), out.positions.len() as u32);
        let v = axis.cross(u);
        let corner = |(a, b): (f32, f32)| centre + (axis + u * a + v * b) * 0.5 * side;
        out.positions.extend([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner));
        out.normals.extend([axis; 4]);
        out.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|v| v + first)));
    }
    out.material = vec![0; 12];
    out
}

fn joined(mut a: Surface, b: &Surface) -> Surface {
    let first = a.positions.len() as u32;
    a.positions.extend(&b.positions);
    a.normals.extend(&b.normals);
    a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
    a.material.extend(&b.material);
    a
}

fn plain(surface: Surface) -> Model {
    Model { surface, materials: vec![Material::default()], ..Model::empty("boxes") }
}

#[test]
fn what_nothing_sees_goes_first() {
    let surface = reduced(&plain(joined(cube(2.0, Vec3::ZERO), &cube(1.0, Vec3::ZERO))), 12);
    assert_eq!(surface.triangles.len(), 12);
    assert_eq!(welded(&surface).area(), 24.0);
}

#[test]
fn a_small_thing_vanishes_before_a_large_one_is_bent() {
    let surface = reduced(&plain(joined(cube(2.0, Vec3::ZERO), &cube(0.02, Vec3::X * 1.5))), 12);
    let (low, high) = welded(&surface).bounds();
    assert_eq!((low, high), (-Vec3::ONE, Vec3::ONE));
}

#[test]
fn flat_faces_have_the_normals_of_their_new_shape() {
    let surface = reduced(&plain(cube(2.0, Vec3::ZERO)), 8);
    let mesh = welded(&surface);
    for (t, triangle) in surface.triangles.iter().enumerate() {
        let normal = mesh.area_vector(t).normalize();
        assert!(triangle.iter().all(|&v| surface.normals[v as usize].distance(normal) < 1e-5));
    }
}

#[test]
fn morph_targets_and_colours_go_with_their_vertices() {
    let mut surface = grid(4, |x, _| x * x);
    surface.colors = surface.positions.iter().map(|p| Vec4::new(p.x, p.y, 0.0, 1.0)).collect();
    let displacements = (0..).zip(&surface.positions).map(|(v, p)| (v, Vec3::Z * p.x)).filter(|(_, d)| d.z > 0.0);
    let target = crate::data::MorphTarget { displacements: displacements.collect(), ..Default::default() };
    surface.morphs = Some(Morphs { node: 0, targets: vec![target] });
    let surface = reduced(&textured(surface, 64), 12);
    let target = &surface.morphs.as_ref().expect("morph targets").targets[0];
    for (v, p) in (0..).zip(&surface.positions) {
        let color = surface.colors[v as usize];
        assert!((target.displacement(v).z - p.x).abs() < 1e-4 && (color.x - p.x).abs() < 1e-3, "{p} {color}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn height_fields_stay_manifold_within_budget(
        heights in prop::collection::vec(-0.3f32..0.3, 121), budget in 2u32..150,
    ) {
        let surface = grid(10, |x, y| heights[((y * 10.0).round() * 11.0 + (x * 10.0).round()) as usize]);
        reduced(&textured(surface, 64), budget);
    }
}
