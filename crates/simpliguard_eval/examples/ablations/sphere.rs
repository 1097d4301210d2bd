//! A sphere with bumps and a pattern, of any number of triangles.

use std::error::Error;
use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3, Vec4};
use image::{Rgba, RgbaImage};
use serde_json::json;
use simpliguard::data::{
    AlphaMode, Document, LayerMaterial, Level, LevelLayer, LevelMaterial, LevelMesh, LevelTextures, Model, TriMesh,
};
use simpliguard::gltf::export_level;
use simpliguard::settings::TextureFormat;

/// Side of its texture.
const TEXTURE: u32 = 1024;

/// A binary glTF of about so many triangles.
pub(crate) fn glb(faces: usize) -> Result<Vec<u8>, Box<dyn Error>> {
    let material = LevelMaterial {
        alpha_mode: AlphaMode::Opaque,
        double_sided: false,
        unlit: false,
        metallic: 0.0,
        roughness: 0.8,
        emissive: Vec3::ZERO,
        base_color: Vec4::ONE,
        transmission: None,
    };
    let textures = LevelTextures {
        base_color: Some(RgbaImage::from_fn(TEXTURE, TEXTURE, |x, y| {
            let [u, v] = [x, y].map(|c| c as f32 / TEXTURE as f32);
            let stripes = |frequency: f32, at: f32| 0.5 + 0.4 * (frequency * at * TAU).sin();
            let color = [stripes(8.0, u + 0.1 * stripes(3.0, v)), stripes(5.0, v), stripes(13.0, u + v)];
            let [r, g, b] = color.map(|c| (255.0 * c) as u8);
            Rgba([r, g, b, 255])
        })),
        normal: None,
        occlusion_roughness_metallic: None,
        emissive: None,
        format: TextureFormat::Png,
    };
    let mesh = mesh(faces);
    let layers = vec![LevelLayer { triangles: mesh.triangles.len(), material: LayerMaterial::Baked(material) }];
    let level = Level { budget: mesh.triangles.len() as u32, error: 0.0, mesh, own_joints: false, layers, textures };
    let document = Document { json: json!({ "asset": { "version": "2.0" } }), ..Document::default() };
    Ok(export_level(&Model { document, ..Model::empty("sphere") }, &level)?)
}

/// Quads between meridians and twice as many parallels, seam and poles apart.
fn mesh(faces: usize) -> LevelMesh {
    let rows = ((faces as f32 / 4.0).sqrt() as u32).max(2);
    let columns = 2 * rows;
    let mut out = LevelMesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let uv = Vec2::new(column as f32 / columns as f32, row as f32 / rows as f32);
            let (along, down) = (TAU * uv.x, PI * uv.y);
            let unit = Vec3::new(down.sin() * along.cos(), down.cos(), down.sin() * along.sin());
            let bumps: f32 = [(3.0, 0.08), (7.0, 0.04), (17.0, 0.015)]
                .map(|(f, height): (f32, f32)| height * ((f * unit.x).sin() + (f * unit.y).sin() * (f * unit.z).cos()))
                .iter()
                .sum();
            out.positions.push(unit * (1.0 + bumps));
            out.uvs.push(uv);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let b = a + columns + 1;
            out.triangles.extend([[a, a + 1, b], [a + 1, b + 1, b]]);
        }
    }
    out.normals = TriMesh { positions: out.positions.clone(), triangles: out.triangles.clone() }.vertex_normals();
    out
}
