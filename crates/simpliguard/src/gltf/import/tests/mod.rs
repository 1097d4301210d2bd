//! Tests of the whole import on hand-built files and on real ones.

mod blobs;
mod builder;
mod compression;
mod corpus;
mod draco;
mod geometry;
mod hostile;
mod ktx2;
mod materials;
mod memory;
mod skins;
mod webp;

use crate::data::Model;

/// What holds for every model that the import returns.
fn assert_sound(model: &Model) {
    let (surface, name) = (&model.surface, &model.name);
    let count = surface.positions.len();
    let full_or_empty = |len: usize| len == count || len == 0;
    assert_eq!([surface.normals.len(), surface.uvs[0].len()], [count; 2], "{name}");
    assert!(full_or_empty(surface.tangents.len()) && full_or_empty(surface.uvs[1].len()), "{name}");
    assert!(full_or_empty(surface.colors.len()), "{name}");
    assert_eq!(surface.material.len(), surface.triangles.len(), "{name}");
    assert!(surface.material.iter().all(|&m| (m as usize) < model.materials.len()), "{name}");
    assert!(surface.triangles.iter().flatten().all(|&v| (v as usize) < count), "{name}");
    assert!(surface.positions.iter().all(|p| p.is_finite()), "{name}");
    assert!(surface.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{name}");
    let mut used = vec![false; count];
    surface.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    assert!(used.iter().all(|&used| used), "{name}: a vertex without a face");
    for material in &model.materials {
        for texture in [
            material.base_color_texture,
            material.metallic_roughness_texture,
            material.normal_texture,
            material.occlusion_texture,
            material.emissive_texture,
        ]
        .into_iter()
        .flatten()
        {
            assert!(texture.texture < model.textures.len() && texture.uv_set < 2, "{name}");
            assert!(count == 0 || surface.uvs[texture.uv_set].len() == count, "{name}");
        }
    }
    let bones = model.rig.as_ref().map_or(0, |rig| rig.bones.len());
    assert_eq!(surface.influences.len(), if model.rig.is_some() { count } else { 0 }, "{name}");
    for influences in &surface.influences {
        assert!((influences.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{name}");
        assert!(influences.weights.is_sorted_by(|a, b| a >= b), "{name}");
        assert!(influences.joints.iter().all(|&joint| usize::from(joint) < bones), "{name}");
    }
    assert_eq!(model.document.buffers.len(), model.document.json["buffers"].as_array().map_or(0, Vec::len), "{name}");
    assert_eq!(model.document.images.len(), model.document.json["images"].as_array().map_or(0, Vec::len), "{name}");
}
