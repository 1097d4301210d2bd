//! Exports of real models, with every n-th triangle as a level.
//!
//! Checks on the written bytes that skinning in the rest pose gives the level's world positions back. With
//! `SIMPLIGUARD_EXPORT_DIR` set, all of `shared/assets/dev` is written there as `<stem>.<form>.glb`, for the Khronos
//! validator and for a comparison of posed frames.

use std::path::{Path, PathBuf};

use glam::{Mat4, Vec2, Vec3};
use image::{Rgba, RgbaImage};

use super::tests::Read;
use super::{ExportOptions, SourceGeometry, export, export_level};
use crate::gltf::{Limits, import};
use crate::model::{AlphaMode, Level, LevelMaterial, LevelMesh, LevelTextures, Model};
use crate::{NoResources, Source};

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/assets");

/// The files of a folder of `shared/assets`, by name.
fn files(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(ASSETS).join(folder);
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).map_or_else(|_| Vec::new(), |dir| dir.flatten().map(|f| f.path()).collect());
    files.retain(|f| f.extension().is_some_and(|e| e == "glb" || e == "gltf"));
    files.sort();
    files
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
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
        mesh,
        material: LevelMaterial {
            alpha_mode: AlphaMode::Opaque,
            double_sided: true,
            unlit: false,
            metallic: 0.0,
            roughness: 1.0,
            emissive: Vec3::ZERO,
        },
        textures: LevelTextures {
            base_color: RgbaImage::from_pixel(4, 4, Rgba([200, 150, 100, 255])),
            normal: None,
            occlusion_roughness_metallic: None,
            emissive: None,
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
    let options = ExportOptions::default();
    let kept = file("kept", &export(model, &levels, &options).expect("exports"));
    let options = ExportOptions { source: SourceGeometry::Drop, ..options };
    file("dropped", &export(model, &levels, &options).expect("exports"));
    file("level", &export_level(model, &levels[2]).expect("exports"));
    let (low, high) = crate::mesh::bounds(&model.surface.positions);
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
        let written = crate::mesh::bounds(&written);
        let expected = crate::mesh::bounds(&expected);
        assert!(f64::from(written.0.distance(expected.0)) < tolerance, "{stem}: {written:?} {expected:?}");
        assert!(f64::from(written.1.distance(expected.1)) < tolerance, "{stem}: {written:?} {expected:?}");
    }
}

#[test]
#[expect(clippy::print_stderr, reason = "a skipped test says so")]
fn real_models_keep_their_rest_pose() {
    let mut files = files("dev");
    if files.is_empty() {
        eprintln!("no models at {ASSETS}: nothing checked");
    }
    if std::env::var_os("SIMPLIGUARD_EXPORT_DIR").is_none() {
        files.retain(|f| ["brainstem", "fox_dense", "machine"].contains(&stem(f).as_str()));
    }
    for path in files {
        let bytes = std::fs::read(&path).expect("readable");
        let name = stem(&path);
        let source = Source { name: &name, bytes: &bytes, resources: &NoResources };
        check(&name, &import(&source, &Limits::default()).expect("imports"));
    }
}

#[test]
fn whatever_the_import_takes_is_exported() {
    for path in files("hostile") {
        let bytes = std::fs::read(&path).expect("readable");
        let name = stem(&path);
        let source = Source { name: &name, bytes: &bytes, resources: &NoResources };
        let Ok(model) = import(&source, &Limits::default()) else { continue };
        if model.surface.triangles.is_empty() {
            continue;
        }
        let level = [sparse_level(&model, 1)];
        Read::new(&format!("hostile.{name}.level"), &export_level(&model, &level[0]).expect("exports"));
        for source in [SourceGeometry::Keep, SourceGeometry::Drop] {
            let options = ExportOptions { source, ..ExportOptions::default() };
            let glb = export(&model, &level, &options).expect("exports");
            Read::new(&format!("hostile.{name}.{source:?}"), &glb);
        }
    }
}
