//! The repository's own rigged model through the whole chain.

use std::collections::HashMap;
use std::sync::LazyLock;

use simpliguard::data::{Atlas, Level, LevelMesh, TriMesh};
use simpliguard::geometry::{BoundingSphere, Topology, fibonacci_directions};
use simpliguard::render::{Camera, Image, Light, Renderer, SurfaceSampler};
use simpliguard::settings::{BakeSettings, Quality};
use simpliguard::unwrap::{flips, overlaps};
use simpliguard::{Baked, Context, NoResources, PIPELINE_VERSION, Source, Status, bake};

/// The pipeline version and the hash of the octopus baked with [`settings`]: outputs must not change without the version.
const GOLDEN: (&str, &str) = ("31", "8cd32e7bcebf46724ddca200143967e6d0e7670970a9c77f0f4ce556e224ed84");

pub(super) static OCTOPUS: LazyLock<Baked> = LazyLock::new(|| {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/octopus.glb")).expect("in the repository");
    let source = Source { name: "octopus", bytes: &bytes, resources: &NoResources };
    bake(&source, &settings(), &Context::default()).expect("bakes")
});

fn settings() -> BakeSettings {
    BakeSettings {
        faces: vec![1000, 4000],
        texture_size: 256.into(),
        refine_steps: 20,
        ..BakeSettings::preset(Quality::Draft)
    }
}

fn welded(mesh: &LevelMesh) -> TriMesh {
    let mut ids = HashMap::new();
    let mut out = TriMesh::default();
    let vertex: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            *ids.entry(p.to_array().map(f32::to_bits)).or_insert_with(|| {
                out.positions.push(*p);
                out.positions.len() as u32 - 1
            })
        })
        .collect();
    out.triangles = mesh.triangles.iter().map(|t| t.map(|v| vertex[v as usize])).collect();
    out
}

#[test]
fn levels_meet_their_budgets_as_manifolds() {
    assert_eq!(OCTOPUS.report.status, Status::Baked);
    for level in &OCTOPUS.levels {
        let (faces, budget) = (level.mesh.triangles.len(), level.budget as usize);
        assert!(faces <= budget && faces * 100 >= budget * 98, "{faces} of {budget}");
        let topology = Topology::of(&welded(&level.mesh));
        assert!(topology.is_manifold() && topology.degenerate == 0, "{budget}: {topology:?}");
    }
}

#[test]
fn charts_neither_overlap_nor_flip() {
    for Level { mesh, .. } in &OCTOPUS.levels {
        assert!(mesh.uvs.iter().all(|uv| uv.min_element() >= 0.0 && uv.max_element() <= 1.0));
        let uvs = mesh.triangles.iter().map(|t| t.map(|v| mesh.uvs[v as usize])).collect();
        let atlas = Atlas { uvs, ..Atlas::default() };
        assert_eq!((overlaps(&atlas, 1024), flips(&atlas)), (0, 0));
    }
}

#[test]
fn every_vertex_hangs_on_the_skeleton() {
    let bones = OCTOPUS.model.as_ref().and_then(|m| m.rig.as_ref()).expect("it is rigged").bones.len();
    for Level { mesh, .. } in &OCTOPUS.levels {
        assert_eq!(mesh.influences.len(), mesh.positions.len());
        for influences in &mesh.influences {
            assert!((influences.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            assert!(influences.joints.iter().all(|&j| usize::from(j) < bones));
        }
    }
}

#[test]
fn levels_look_like_the_source() {
    let source = OCTOPUS.model.as_ref().expect("imported");
    let frame = BoundingSphere::around(&source.surface.positions);
    let cameras: Vec<Camera> =
        fibonacci_directions(6).into_iter().map(|d| Camera::orbit(&frame, d, 0.7, 1.02)).collect();
    let draw = |model: &simpliguard::data::Model| -> Vec<Image> {
        let sampler = SurfaceSampler::new(model);
        let mut renderer = Renderer::new(&sampler, 256, 2);
        cameras.iter().flat_map(|camera| renderer.draw(camera, [Light::None])).collect()
    };
    let expected = draw(source);
    for (level, least) in OCTOPUS.levels.iter().zip([27.0, 32.0]) {
        let pictures = draw(&level.to_model(source));
        let mean = pictures.iter().zip(&expected).map(|(a, b)| psnr(a, b)).sum::<f64>() / cameras.len() as f64;
        assert!(mean > least, "{} faces: {mean:.2} dB", level.budget);
    }
}

#[test]
fn the_output_opens_in_the_reference_loader_with_a_scene_per_level() {
    let file = gltf::Gltf::from_slice(&OCTOPUS.glb).expect("valid");
    let scenes: Vec<_> = file.scenes().map(|s| s.name().unwrap_or_default().to_owned()).collect();
    assert_eq!(scenes[scenes.len() - 2..], ["LOD1", "LOD2"]);
    let bin = file.blob.as_deref().expect("one buffer");
    for (scene, level) in file.scenes().skip(scenes.len() - 2).zip(&OCTOPUS.levels) {
        let mut nodes: Vec<_> = scene.nodes().collect();
        let mut meshes = Vec::new();
        while let Some(node) = nodes.pop() {
            nodes.extend(node.children());
            meshes.extend(node.mesh().map(|mesh| (mesh, node.skin().is_some())));
        }
        let [(mesh, true)] = &meshes[..] else { panic!("one skinned mesh, not {}", meshes.len()) };
        let primitive = mesh.primitives().next().expect("one primitive");
        let indices = primitive.reader(|_| Some(bin)).read_indices().expect("indexed").into_u32().count();
        assert_eq!(indices, 3 * level.mesh.triangles.len());
    }
}

/// On white, in dB.
fn psnr(a: &Image, b: &Image) -> f64 {
    let (a, b) = (a.over(1.0), b.over(1.0));
    let squared: f64 = a.iter().zip(b.iter()).map(|(x, y)| (f64::from(*x) - f64::from(*y)).powi(2)).sum();
    // Alpha is 255 in both.
    -10.0 * (squared / (255.0 * 255.0 * 3.0 * f64::from(a.width() * a.height()))).log10()
}

#[test]
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
fn outputs_change_with_the_pipeline_version_only() {
    let hash = blake3::hash(&OCTOPUS.glb).to_hex().to_string();
    assert_eq!(
        (PIPELINE_VERSION, hash.as_str()),
        GOLDEN,
        "the output changed: raise PIPELINE_VERSION, then put both values into GOLDEN"
    );
}
