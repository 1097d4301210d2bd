//! Speed of the stages that [`geometry`](../geometry.rs) leaves out, on fixed inputs, and of the whole bake with 1 to 8
//! threads, beside meshoptimizer in the same run.
//!
//! `cargo bench -p simpliguard --bench stages`; `simpliguard bench` has the whole bake of any size or model.

mod shared;

use std::sync::LazyLock;

use divan::{Bencher, black_box};
use glam::Vec4;
use simpliguard::data::{Atlas, Model, TriMesh};
use simpliguard::geometry::{BoundingSphere, Bvh};
use simpliguard::refine::{Cpu, LowPoly, RefineParams, Solver, TexelGrid, TextureFit, ViewTarget, fit_texture, refine};
use simpliguard::render::{Sampling, SurfaceSample, SurfaceSampler, View, take_views, viewpoints};
use simpliguard::settings::BakeSettings;
use simpliguard::texture::{BakeTarget, Baker, Channels, TexelMap, corner_normals, level_mesh, pbr_maps, tangents};
use simpliguard::unwrap::{UnwrapParams, unwrap};
use simpliguard::{Cancellation, Context, NoResources, Params, Source, bake, gltf, simplify};

use shared::{SIZES, meshopt_collapse, torus_model};

/// A model that moves, of 41,376 triangles.
const OCTOPUS: &[u8] = include_bytes!("../../../assets/octopus.glb");
/// Numbers of triangles of the levels.
const BUDGETS: [usize; 3] = [1000, 2000, 4000];
/// Side of a view in pixels, and number of views.
const VIEWS: (usize, usize) = (512, 48);
/// Side of a texture in texels.
const TEXTURE: usize = 512;
/// Steps of the vertices.
const STEPS: u32 = 25;
const ATLAS: UnwrapParams = UnwrapParams { size: TEXTURE as u32, gutter: 4 };

fn main() {
    divan::main();
}

/// A source of 100,352 triangles, and a level of it before its vertices move.
struct Scene {
    source: Model,
    sphere: BoundingSphere,
    bvh: Bvh,
    views: Vec<View>,
    level: TriMesh,
    atlas: Atlas,
    texels: TexelMap,
}

static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let source = torus_model(SIZES[1]);
    let surface = &source.surface;
    let (positions, triangles) = (surface.positions.clone(), surface.triangles.clone());
    let sphere = BoundingSphere::around(&positions);
    let level = simplify::collapse(&TriMesh { positions, triangles }, BUDGETS[0]);
    let atlas = unwrap(&level, None, &ATLAS, &Cancellation::default());
    Scene {
        sphere,
        bvh: Bvh::new(&surface.positions, &surface.triangles),
        views: views(&source),
        texels: TexelMap::new(&atlas, TEXTURE),
        level,
        atlas,
        source,
    }
});

fn views(source: &Model) -> Vec<View> {
    let (size, count) = VIEWS;
    let cameras = viewpoints(&BoundingSphere::around(&source.surface.positions), count, 1);
    take_views(&SurfaceSampler::new(source), &cameras, Sampling::antialiased(size))
}

impl Scene {
    fn samples(&self) -> Vec<Option<SurfaceSample>> {
        let sampler = SurfaceSampler::new(&self.source);
        let target = BakeTarget {
            mesh: &self.level,
            atlas: &self.atlas,
            texels: &self.texels,
            cards: None,
            keeps_area: false,
            parts: None,
        };
        let baker = Baker { sampler: &sampler, bvh: &self.bvh, bounding_sphere: self.sphere };
        baker.bake(&target, &Cancellation::default())
    }

    /// The level with a grey texture.
    fn low_poly(&self) -> LowPoly {
        let covered: Vec<bool> = self.texels.texels.iter().map(Option::is_some).collect();
        let texels = vec![Vec4::new(0.5, 0.5, 0.5, 1.0); covered.len()];
        LowPoly::new(&self.level, &self.atlas, false, TexelGrid { size: TEXTURE, texels, covered, opacity: Vec::new() })
    }
}

fn fit() -> TextureFit {
    TextureFit { smoothness: 0.1, trust: None, solver: Solver::LeastSquares }
}

#[divan::bench(args = SIZES, sample_count = 3)]
fn render_views(bencher: Bencher<'_, '_>, n: u32) {
    let source = torus_model(n);
    bencher.bench_local(|| views(black_box(&source)));
}

#[divan::bench(sample_count = 5)]
fn unwrap_level() -> Atlas {
    unwrap(black_box(&SCENE.level), None, &ATLAS, &Cancellation::default())
}

#[divan::bench(sample_count = 5)]
fn bake_texture() -> Vec<Option<SurfaceSample>> {
    SCENE.samples()
}

#[divan::bench(sample_count = 5)]
fn fit_texture_by_least_squares(bencher: Bencher<'_, '_>) {
    let fitted = |mut low: LowPoly| fit_texture(&mut low, &SCENE.views, Some(&fit()), &Cpu, &Cancellation::default());
    bencher.with_inputs(|| SCENE.low_poly()).bench_local_values(fitted);
}

#[divan::bench(sample_count = 3)]
fn move_vertices(bencher: Bencher<'_, '_>) {
    let vertices = Params::new(&BakeSettings::default()).refine.vertices;
    let params = RefineParams { steps: STEPS, coarse: 0.0, texture: Some(fit()), ..vertices };
    let Scene { views, bvh, sphere, .. } = &*SCENE;
    let target = ViewTarget { views, half_resolution: &[], bvh, radius: sphere.radius, seed: 1 };
    let moved = |mut low: LowPoly| refine((&mut low, None), &target, &params, &Cpu, &Cancellation::default());
    bencher.with_inputs(|| SCENE.low_poly()).bench_local_values(moved);
}

#[divan::bench(sample_count = 5)]
fn make_maps(bencher: Bencher<'_, '_>) {
    let Scene { level, atlas, texels, .. } = &*SCENE;
    let samples = SCENE.samples();
    let (normals, inverted) = (corner_normals(level, atlas, texels, &samples), vec![false; level.triangles.len()]);
    let mut mesh = level_mesh((level, atlas), &normals, &inverted, &[], &[]);
    mesh.tangents = tangents(&mesh);
    let colors = vec![Vec4::ONE; samples.len()];
    let channels = Channels { normal: true, ..Channels::default() };
    bencher.bench_local(|| pbr_maps(&mesh, texels, black_box(&samples), &colors, channels));
}

/// The default settings, with so many threads.
#[divan::bench(args = [1, 2, 4, 8], sample_count = 1)]
fn whole_bake(bencher: Bencher<'_, '_>, threads: usize) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let source = Source { name: "octopus", bytes: OCTOPUS, resources: &NoResources };
    let (settings, context) = (BakeSettings::default(), Context::default());
    bencher.bench_local(|| pool.install(|| bake(black_box(&source), &settings, &context)).expect("levels"));
}

/// The same model to the same numbers of triangles.
#[divan::bench(sample_count = 5)]
fn whole_bake_by_meshopt(bencher: Bencher<'_, '_>) {
    let source = Source { name: "octopus", bytes: OCTOPUS, resources: &NoResources };
    let model = gltf::import(&source, &gltf::ImportLimits::default()).expect("the model is sound");
    let surface = &model.surface;
    bencher.bench_local(|| meshopt_collapse(black_box(&surface.positions), &surface.triangles, &BUDGETS));
}
