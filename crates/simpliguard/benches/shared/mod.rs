//! The inputs of the benchmarks, and meshoptimizer beside them.

use glam::{Vec3, Vec4};
use simpliguard::data::{Material, Model, Surface, TriMesh};

/// Samples along the two circles of a torus: 10,082, 100,352, 294,912, 999,698 and 2,000,000 triangles.
pub(crate) const SIZES: [u32; 5] = [71, 224, 384, 707, 1000];

/// A bumpy torus of `2 n n` triangles: smooth, curved in both directions, with a hole.
pub(crate) fn torus(n: u32) -> TriMesh {
    let angle = |i: u32| i as f32 / n as f32 * std::f32::consts::TAU;
    let at = |i: u32| {
        let (u, v) = (angle(i % n), angle(i / n));
        let tube = 0.3 + 0.02 * libm::sinf(11.0 * u) * libm::cosf(7.0 * v);
        let ring = 1.0 + tube * libm::cosf(v);
        Vec3::new(ring * libm::cosf(u), tube * libm::sinf(v), ring * libm::sinf(u))
    };
    let quad = |i: u32| {
        let (x, y) = (i % n, i / n);
        let corner = |dx: u32, dy: u32| (x + dx) % n + (y + dy) % n * n;
        [[corner(0, 0), corner(0, 1), corner(1, 1)], [corner(0, 0), corner(1, 1), corner(1, 0)]]
    };
    TriMesh { positions: (0..n * n).map(at).collect(), triangles: (0..n * n).flat_map(quad).collect() }
}

/// The torus as a source, with stripes as vertex colours.
pub(crate) fn torus_model(n: u32) -> Model {
    let mesh = torus(n);
    let stripes = |p: &Vec3| Vec4::new(0.5 + 0.4 * libm::sinf(9.0 * p.x), 0.5 + 0.4 * libm::sinf(7.0 * p.z), 0.4, 1.0);
    let surface = Surface {
        normals: mesh.vertex_normals(),
        colors: mesh.positions.iter().map(stripes).collect(),
        material: vec![0; mesh.triangles.len()],
        positions: mesh.positions,
        triangles: mesh.triangles,
        ..Surface::default()
    };
    Model { surface, materials: vec![Material::default()], ..Model::empty("torus") }
}

/// Collapses a surface to each number of triangles by meshoptimizer; returns their indices.
pub(crate) fn meshopt_collapse(positions: &[Vec3], triangles: &[[u32; 3]], targets: &[usize]) -> Vec<Vec<u32>> {
    let vertices = meshopt::VertexDataAdapter::new(bytemuck::cast_slice(positions), size_of::<Vec3>(), 0);
    let vertices = vertices.expect("positions are whole");
    let options = meshopt::SimplifyOptions::None;
    let collapse =
        |target: &usize| meshopt::simplify(triangles.as_flattened(), &vertices, 3 * target, f32::MAX, options, None);
    targets.iter().map(collapse).collect()
}
