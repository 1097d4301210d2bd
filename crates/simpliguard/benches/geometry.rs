//! Speed of reconstruction and collapse, with meshoptimizer on the same mesh in the same run for comparison: machines
//! differ, ratios do not.
//!
//! `cargo bench -p simpliguard --bench geometry`; the throughput is in triangles of the input.
//! `SIMPLIGUARD_BENCH_MODEL` names a glTF, such as a scan, that is simplified as well.

mod shared;

use std::sync::Arc;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::Vec3;
use simpliguard::data::{Cards, Influences, Model, Reconstruction, TriMesh};
use simpliguard::geometry::{BoundingSphere, Bvh};
use simpliguard::reconstruct::reconstruct;
use simpliguard::render::{Sampling, SurfaceSampler, take_views, viewpoints};
use simpliguard::settings::BakeSettings;
use simpliguard::simplify::{self, DeviationMetric, Inputs, OpaqueSurface, SimplifyParams, Tools};
use simpliguard::{Cancellation, NoResources, Params, Source, gltf};

use shared::{SIZES, meshopt_collapse, torus, torus_model};

/// Faces left after each collapse.
const TARGET: usize = 4000;

fn main() {
    divan::main();
}

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
    bencher
        .counter(ItemsCount::new(mesh.triangles.len()))
        .bench_local(|| meshopt_collapse(black_box(&mesh.positions), &mesh.triangles, &[TARGET]));
}

/// The stage `simplify` with reconstruction, for the three levels of the default settings.
#[divan::bench(args = SIZES, sample_count = 1)]
fn shape_three_levels(bencher: Bencher<'_, '_>, n: u32) {
    shape_of(bencher, &torus_model(n));
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
