//! Levels and views of them.

use glam::{Affine3A, Vec2, Vec3, Vec4};
use simpliguard::Cancellation;
use simpliguard::animation::Motions;
use simpliguard::data::{Atlas, TriMesh};
use simpliguard::geometry::{BoundingSphere, Random};
use simpliguard::refine::{Backend, CoveredViews, Cpu, LowPoly, TexelGrid};
use simpliguard::render::{Camera, Image, View, viewpoints};

/// Side of the views. No multiple of a tile.
pub(crate) const SIZE: usize = 200;
const TEXTURE: usize = 64;

/// A smooth texture, of which some texels are in no chart.
fn texture() -> TexelGrid {
    let texel = |i: usize| {
        let (x, y) = ((i % TEXTURE) as f32 / TEXTURE as f32, (i / TEXTURE) as f32 / TEXTURE as f32);
        Vec4::new(0.5 + 0.4 * (5.0 * x).sin(), 0.5 + 0.4 * (4.0 * y).cos(), 0.3 + 0.4 * x, 1.0)
    };
    let texels = (0..TEXTURE * TEXTURE).map(texel).collect();
    let covered = (0..TEXTURE * TEXTURE).map(|i| i % TEXTURE > 2).collect();
    TexelGrid { size: TEXTURE, texels, covered, opacity: Vec::new() }
}

fn level(mesh: TriMesh, double_sided: bool) -> LowPoly {
    let uv = |v: u32| mesh.positions[v as usize].truncate() * Vec2::new(0.35, -0.35) + 0.5;
    let atlas = Atlas { uvs: mesh.triangles.iter().map(|t| t.map(uv)).collect(), ..Atlas::default() };
    LowPoly::new(&mesh, &atlas, double_sided, texture())
}

/// A bumpy ball of `4 n (n - 1)` triangles, with a pose that turns and stretches it.
pub(crate) fn ball(n: usize) -> LowPoly {
    let point = |i: usize, j: usize| {
        let (polar, turn) = (i as f32 / n as f32, (j % (2 * n)) as f32 / n as f32);
        let (polar, turn) = (std::f32::consts::PI * polar, std::f32::consts::PI * turn);
        let radius = 1.0 + 0.15 * (5.0 * polar).sin() * (4.0 * turn).cos();
        radius * Vec3::new(polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin())
    };
    let columns = 2 * n;
    let index = |i: usize, j: usize| match i {
        0 => 0,
        i if i == n => 1,
        i => (2 + (i - 1) * columns + j % columns) as u32,
    };
    let mut positions = vec![point(0, 0), point(n, 0)];
    positions.extend((1..n).flat_map(|i| (0..columns).map(move |j| (i, j))).map(|(i, j)| point(i, j)));
    let quad = |(i, j): (usize, usize)| {
        let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)];
        [[a, b, c], [a, c, d]]
    };
    let triangles = (0..n).flat_map(|i| (0..columns).map(move |j| (i, j))).flat_map(quad);
    let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let pose = Affine3A::from_scale_rotation_translation(
        Vec3::new(1.0, 0.8, 1.1),
        glam::Quat::from_rotation_y(0.7),
        Vec3::X * 0.1,
    );
    let motions = Motions::new(vec![vec![pose; positions.len()]]);
    level(TriMesh { positions, triangles }, false).with_motions(motions)
}

/// Triangles anywhere, seen from both sides, which pass through each other.
pub(crate) fn soup(triangles: usize) -> LowPoly {
    let mut random = Random::new(7);
    let mut mesh = TriMesh::default();
    for t in 0..triangles as u32 {
        let mut vector = || Vec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        let centre = vector() * 0.8;
        mesh.positions.extend([centre + vector() * 0.3, centre + vector() * 0.3, centre + vector() * 0.3]);
        mesh.triangles.push([3 * t, 3 * t + 1, 3 * t + 2]);
    }
    let vertices = mesh.positions.len();
    level(mesh, true).with_motions(Motions::new(vec![vec![Affine3A::IDENTITY; vertices]]))
}

/// Views that `source` is the source of, every third one in its pose.
pub(crate) fn views(source: &LowPoly, count: usize) -> Vec<View> {
    let sphere = BoundingSphere { centre: Vec3::ZERO, radius: 1.3 };
    let cameras = viewpoints(&sphere, count, 3);
    let blank = |(i, camera): (usize, &Camera)| View {
        camera: *camera,
        pose: (i % 3 == 2).then_some(0),
        image: Image { size: SIZE, pixels: vec![[0; 4]; SIZE * SIZE] },
    };
    let mut views: Vec<View> = cameras.iter().enumerate().map(blank).collect();
    let cancellation = Cancellation::default();
    let drawn: Vec<Vec<Vec4>> = {
        let Ok(mut renderer) = Cpu.open(source, CoveredViews::new(views.iter().collect()), &cancellation);
        let draw = |view| {
            let Ok(drawing) = renderer.draw(source, view);
            drawing.colors
        };
        (0..count).map(draw).collect()
    };
    for (view, colors) in views.iter_mut().zip(drawn) {
        view.image.pixels = colors.iter().map(|c| (*c * 255.0 + 0.5).to_array().map(|c| c as u8)).collect();
    }
    views
}

/// A level with a source that it does not look like yet.
pub(crate) fn pair(low: &LowPoly) -> LowPoly {
    let mut source = low.clone();
    source.positions.iter_mut().for_each(|p| *p = *p * 1.05 + Vec3::new(0.02, -0.03, 0.01));
    source.texture.texels.iter_mut().for_each(|texel| *texel = (*texel * 0.9).with_w(1.0));
    source
}
