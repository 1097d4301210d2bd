//! Speed of reconstruction and collapse, with meshoptimizer on the same mesh in the same run for comparison: machines
//! differ, ratios do not.
//!
//! `cargo bench -p simpliguard --bench geometry`; the throughput is in triangles of the input.
//! `SIMPLIGUARD_BENCH_MODEL` names a glTF, such as a scan, that is simplified as well.

use std::sync::Arc;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::Vec3;
use simpliguard::data::{Cards, Influences, Material, Model, Reconstruction, Surface, TriMesh};
use simpliguard::geometry::{BoundingSphere, Bvh};
use simpliguard::reconstruct::reconstruct;
use simpliguard::render::{Sampling, SurfaceSampler, take_views, viewpoints};
use simpliguard::settings::BakeSettings;
use simpliguard::simplify::{self, DeviationMetric, Inputs, OpaqueSurface, SimplifyParams, Tools};
use simpliguard::{Cancellation, NoResources, Params, Source, gltf};

/// Faces left after each collapse.
const TARGET: usize = 4000;

fn main() {
    divan::main();
}

/// A bumpy torus of `2 n n` triangles: smooth, curved in both directions, with a hole.
fn torus(n: u32) -> TriMesh {
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

/// Samples along the two circles: 32,768, 294,912 and 900,000 triangles.
const SIZES: [u32; 3] = [128, 384, 671];

#[divan::bench(args = SIZES, sample_count = 5)]
fn reconstruct_256(bencher: Bencher<'_, '_>, n: u32) {
    let mesh = torus(n);
    let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
    bencher
        .counter(ItemsCount::new(mesh.triangles.len()))
        .bench_local(|| reconstruct(&mesh, &bvh, &[], black_box(&Reconstruction::new(256)), &Cancellation::default()));
}

#[divan::bench(args = SIZES, sample_count = 5)]
fn collapse(bencher: Bencher<'_, '_>, n: u32) {
    let mesh = torus(n);
    bencher.counter(ItemsCount::new(mesh.triangles.len())).bench_local(|| simplify::collapse(black_box(&mesh), TARGET));
}

#[divan::bench(args = SIZES, sample_count = 5)]
fn collapse_by_meshopt(bencher: Bencher<'_, '_>, n: u32) {
    let mesh = torus(n);
    let indices: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    let positions: &[u8] = bytemuck::cast_slice(&mesh.positions);
    let vertices = meshopt::VertexDataAdapter::new(positions, size_of::<Vec3>(), 0).expect("positions are whole");
    bencher.counter(ItemsCount::new(mesh.triangles.len())).bench_local(|| {
        meshopt::simplify(black_box(&indices), &vertices, 3 * TARGET, f32::MAX, meshopt::SimplifyOptions::None, None)
    });
}

/// The stage `simplify` with reconstruction, for the three levels of the default settings.
#[divan::bench(args = SIZES, sample_count = 1)]
fn shape_three_levels(bencher: Bencher<'_, '_>, n: u32) {
    let mesh = torus(n);
    let surface = Surface {
        normals: mesh.vertex_normals(),
        material: vec![0; mesh.triangles.len()],
        positions: mesh.positions,
        triangles: mesh.triangles,
        ..Surface::default()
    };
    let model = Model { surface, materials: vec![Material::default()], ..Model::empty("torus") };
    shape_of(bencher, &model);
}

#[divan::bench(sample_count = 1)]
fn shape_three_levels_of_a_model(bencher: Bencher<'_, '_>) {
    let Ok(path) = std::env::var("SIMPLIGUARD_BENCH_MODEL") else { return };
    let bytes = std::fs::read(&path).expect("the model can be read");
    let source = Source { name: &path, bytes: &bytes, resources: &NoResources };
    shape_of(bencher, &gltf::import(&source, &gltf::ImportLimits::default()).expect("the model is sound"));
}

fn shape_of(bencher: Bencher<'_, '_>, model: &Model) {
    let surface = &model.surface;
    let (sphere, sampler) = (BoundingSphere::around(&surface.positions), SurfaceSampler::new(model));
    let views = take_views(&sampler, &viewpoints(&sphere, 48, 1), Sampling::antialiased(512));
    let Params { candidates, collapse, .. } = Params::new(&BakeSettings::default());
    let params = SimplifyParams { budgets: vec![1000, 2000, 4000], candidates, collapse };
    bencher.counter(ItemsCount::new(surface.triangles.len())).bench_local(|| {
        let bvh = Arc::new(Bvh::new(&surface.positions, &surface.triangles));
        let opaque = OpaqueSurface::of(&sampler, &bvh);
        let inputs = Inputs {
            model,
            bvh: &bvh,
            components: &[],
            opaque: &opaque,
            deviation_metric: &DeviationMetric::new(&opaque, &Cancellation::default()),
            sphere,
            views: &views,
            poses: None,
            importance: None,
            tools: &StillTools,
            cancellation: &Cancellation::default(),
        };
        let generate = |candidate| Ok(simplify::generate(&inputs, &params, candidate));
        simplify::simplify(black_box(&inputs), &params, &generate).expect("shapes")
    });
}

/// The other stages, for a model that does not move.
struct StillTools;

impl Tools for StillTools {
    fn reconstruct(&self, mesh: &TriMesh, bvh: &Bvh, free: &[Vec3], params: &Reconstruction) -> TriMesh {
        reconstruct(mesh, bvh, free, params, &Cancellation::default())
    }

    fn influences(&self, _: &TriMesh) -> Vec<Influences> {
        Vec::new()
    }

    fn has_joint_planes(&self) -> bool {
        false
    }

    fn split_at_joints(&self, mesh: &TriMesh, _: usize) -> TriMesh {
        mesh.clone()
    }

    fn shown(&self, _: &TriMesh, _: Option<&Cards>, points: &[(u32, Vec3)], _: &[f32]) -> Vec<bool> {
        vec![true; points.len()]
    }
}
