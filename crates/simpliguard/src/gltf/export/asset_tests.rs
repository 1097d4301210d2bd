//! Exports of real models, with every n-th triangle as a level.
//!
//! Checks on the written bytes that skinning in the rest pose gives the level's world positions back. With
//! `SIMPLIGUARD_EXPORT_DIR` set, all of `shared/assets/dev` is written there as `dev-<stem>.<form>.glb`, for the
//! Khronos validator and for a comparison of posed frames.

use std::path::{Path, PathBuf};

use bytes::Bytes;
use glam::{Mat4, Vec2, Vec3, Vec4};
use image::{Rgba, RgbaImage};

use super::tests::Read;
use super::{ExportParams, export, export_level};
use crate::data::{
    AlphaMode, LayerMaterial, Level, LevelLayer, LevelMaterial, LevelMesh, LevelTextures, Model, TextureFormat,
};
use crate::gltf::{ImportLimits, import};
use crate::{Error, RelativeUri, Resources, Source};

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/assets");

/// The glTF files below a folder of `shared/assets`, by path.
fn files(folder: &str) -> Vec<PathBuf> {
    let mut open = vec![Path::new(ASSETS).join(folder)];
    let mut files = Vec::new();
    while let Some(folder) = open.pop() {
        for path in std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "glb" || e == "gltf") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// A file name for what is made of a file: its path below `shared/assets` in one word.
fn flat_name(path: &Path) -> String {
    let below = path.strip_prefix(ASSETS).unwrap_or(path);
    below.with_extension("").to_string_lossy().replace(['/', '\\'], "-")
}

/// The files beside a model.
struct Beside<'a>(&'a Path);

impl Resources for Beside<'_> {
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String> {
        std::fs::read(self.0.with_file_name(uri.as_str())).map(Bytes::from).map_err(|error| error.to_string())
    }
}

fn load(path: &Path) -> Result<Model, Error> {
    let bytes = std::fs::read(path).expect("readable");
    let source = Source { name: &flat_name(path), bytes: &bytes, resources: &Beside(path) };
    import(&source, &ImportLimits::default())
}

/// Every `step`-th triangle of the source, untextured.
fn sparse_level(model: &Model, step: usize) -> Level {
    let surface = &model.surface;
    let mut mesh = LevelMesh::default();
    for triangle in surface.triangles.iter().step_by(step) {
        let first = mesh.positions.len() as u32;
        mesh.triangles.push([first, first + 1, first + 2]);
        for v in triangle.map(|v| v as usize) {
            mesh.positions.push(surface.positions[v]);
            mesh.normals.push(surface.normals[v]);
            mesh.uvs.push(Vec2::ZERO);
            mesh.influences.extend(surface.influences.get(v));
        }
    }
    Level {
        budget: mesh.triangles.len() as u32,
        error: 0.0,
        own_joints: false,
        mesh,
        layers: vec![LevelLayer {
            triangles: surface.triangles.len().div_ceil(step),
            material: LayerMaterial::Baked(LevelMaterial {
                alpha_mode: AlphaMode::Opaque,
                double_sided: true,
                unlit: false,
                metallic: 0.0,
                roughness: 1.0,
                emissive: Vec3::ZERO,
                base_color: Vec4::ONE,
                transmission: None,
            }),
        }],
        textures: LevelTextures {
            base_color: Some(RgbaImage::from_pixel(4, 4, Rgba([200, 150, 100, 255]))),
            normal: None,
            occlusion_roughness_metallic: None,
            emissive: None,
            format: TextureFormat::Png,
        },
    }
}

/// World positions of a written mesh in the rest pose, by the skin as written and the model's node matrices.
fn rest_positions(model: &Model, read: &Read, node: usize) -> Vec<Vec3> {
    let node = &read.json["nodes"][node];
    let attributes = read.attributes(node["mesh"].as_u64().expect("mesh") as usize);
    let positions = read.floats(&attributes["POSITION"], 3);
    let positions = positions.chunks_exact(3).map(Vec3::from_slice);
    let Some(skin) = node["skin"].as_u64() else { return positions.collect() };
    let skin = &read.json["skins"][skin as usize];
    let matrices = read.floats(&skin["inverseBindMatrices"], 16);
    let joints: Vec<Mat4> = skin["joints"]
        .as_array()
        .expect("joints")
        .iter()
        .zip(matrices.chunks_exact(16))
        .map(|(joint, m)| model.document.node_world[joint.as_u64().expect("node") as usize] * Mat4::from_cols_slice(m))
        .collect();
    let accessor = attributes["JOINTS_0"].as_u64().expect("joints") as usize;
    let slots = read.bytes(accessor, 4);
    let weights = read.floats(&attributes["WEIGHTS_0"], 4);
    positions
        .zip(slots.chunks_exact(4).zip(weights.chunks_exact(4)))
        .map(|(p, (slots, weights))| {
            slots.iter().zip(weights).map(|(&j, &w)| joints[j as usize].transform_point3(p) * w).sum()
        })
        .collect()
}

fn check(stem: &str, model: &Model) {
    let levels = [40, 20, 10].map(|step| sparse_level(model, step));
    let file = |form: &str, glb: &[u8]| Read::new(&format!("{stem}.{form}"), glb);
    let kept = file("kept", &export(model, &levels, &ExportParams::default()).expect("exports"));
    file("dropped", &export(model, &levels, &ExportParams { keep_source: false }).expect("exports"));
    file("level", &export_level(model, &levels[2]).expect("exports"));
    let (low, high) = crate::data::bounds(&model.surface.positions);
    let ids: Vec<usize> = kept.json["nodes"]
        .as_array()
        .expect("nodes")
        .iter()
        .filter_map(|n| n.pointer("/extensions/MSFT_lod/ids"))
        .flat_map(|ids| ids.as_array().expect("ids").iter().map(|i| i.as_u64().expect("index") as usize))
        .collect();
    assert_eq!(ids.len(), 3);
    for (node, level) in ids.iter().zip(levels.iter().rev()) {
        let sorted = |mut all: Vec<Vec3>| {
            all.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
            all
        };
        let sum = |all: &[Vec3]| all.iter().map(|p| p.as_dvec3()).sum::<glam::DVec3>() / all.len() as f64;
        let (written, expected) = (rest_positions(model, &kept, *node), sorted(level.mesh.positions.clone()));
        assert_eq!(written.len(), expected.len());
        let tolerance = 1e-5 * f64::from((high - low).length());
        assert!(sum(&written).distance(sum(&expected)) < tolerance, "{stem}");
        let written = crate::data::bounds(&written);
        let expected = crate::data::bounds(&expected);
        assert!(f64::from(written.0.distance(expected.0)) < tolerance, "{stem}: {written:?} {expected:?}");
        assert!(f64::from(written.1.distance(expected.1)) < tolerance, "{stem}: {written:?} {expected:?}");
    }
}

#[test]
#[expect(clippy::print_stderr, reason = "a skipped test says so")]
fn real_models_keep_their_rest_pose() {
    let mut files = files("dev");
    if files.is_empty() {
        eprintln!("skipped: no models in {ASSETS}");
    }
    if std::env::var_os("SIMPLIGUARD_EXPORT_DIR").is_none() {
        files.retain(|f| ["brainstem", "fox_dense", "machine"].iter().any(|name| f.ends_with(format!("{name}.glb"))));
    }
    for path in files {
        check(&flat_name(&path), &load(&path).expect("imports"));
    }
}

#[test]
fn whatever_the_import_takes_is_exported() {
    for path in files("hostile") {
        let Ok(model) = load(&path) else { continue };
        if model.surface.triangles.is_empty() {
            continue;
        }
        let name = flat_name(&path);
        let level = [sparse_level(&model, 1)];
        Read::new(&format!("{name}.level"), &export_level(&model, &level[0]).expect("exports"));
        for (keep_source, source) in [(true, "Keep"), (false, "Drop")] {
            let glb = export(&model, &level, &ExportParams { keep_source }).expect("exports");
            Read::new(&format!("{name}.{source}"), &glb);
        }
    }
}
