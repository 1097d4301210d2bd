//! Reduced surfaces as levels.

use glam::{Vec2, Vec4};

use super::lattices::FACES_PER_CARD;
use super::level_maker::LevelMaker;
use super::level_whole::is_short;
use super::report::{LevelReport, LevelTopology};
use crate::data::{AlphaMode, LayerMaterial, Level, LevelLayer, LevelMesh, LevelTextures, Surface, TriMesh};
use crate::geometry::first_coincident;
use crate::simplify::Reduced;
use crate::skinning;

/// A reduced surface as a level in place of another of the same budget; with `cards` behind it, which are a level of their own.
pub(super) fn level(surface: &Surface, cards: Option<&Level>, other: &Level) -> Level {
    let layers = surface.material.chunk_by(|a, b| a == b);
    let layers = layers.map(|run| LevelLayer { triangles: run.len(), material: LayerMaterial::Source(run[0]) });
    let morphs = if other.mesh.morphs.is_empty() { Vec::new() } else { skinning::surface_morphs(surface) };
    let mesh = LevelMesh {
        positions: surface.positions.clone(),
        normals: surface.normals.clone(),
        tangents: surface.tangents.clone(),
        uvs: surface.uvs[0].clone(),
        second_uvs: surface.uvs[1].clone(),
        colors: surface.colors.clone(),
        influences: surface.influences.clone(),
        triangles: surface.triangles.clone(),
        morphs,
    };
    let textures = LevelTextures {
        base_color: None,
        normal: None,
        occlusion_roughness_metallic: None,
        emissive: None,
        format: other.textures.format,
    };
    let (budget, own_joints) = (other.budget, other.own_joints);
    let mut level = Level { budget, error: 0.0, mesh, own_joints, layers: layers.collect(), textures };
    if let Some(cards) = cards {
        append(&mut level.mesh, &cards.mesh);
        level.layers.extend_from_slice(&cards.layers);
        level.textures = cards.textures.clone();
    }
    level
}

/// Appends a mesh. What only one of them has takes the values that say nothing in the other.
fn append(mesh: &mut LevelMesh, other: &LevelMesh) {
    let counts = [mesh.positions.len(), other.positions.len()];
    let offset = counts[0] as u32;
    mesh.positions.extend_from_slice(&other.positions);
    mesh.normals.extend_from_slice(&other.normals);
    mesh.uvs.extend_from_slice(&other.uvs);
    append_padded(&mut mesh.tangents, &other.tangents, counts, Vec4::ZERO);
    append_padded(&mut mesh.second_uvs, &other.second_uvs, counts, Vec2::ZERO);
    append_padded(&mut mesh.colors, &other.colors, counts, Vec4::ONE);
    mesh.influences.extend_from_slice(&other.influences);
    mesh.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|v| v + offset)));
    for (morph, other) in mesh.morphs.iter_mut().zip(&other.morphs) {
        morph.positions.extend_from_slice(&other.positions);
        morph.normals.extend_from_slice(&other.normals);
    }
}

/// Appends values of `counts[1]` vertices to those of `counts[0]`; none stay none.
fn append_padded<T: Clone>(values: &mut Vec<T>, other: &[T], counts: [usize; 2], nothing: T) {
    if values.is_empty() && other.is_empty() {
        return;
    }
    values.resize(counts[0], nothing.clone());
    values.extend_from_slice(other);
    values.resize(counts[0] + counts[1], nothing);
}

/// The report of a reduced level, in place of another of the same budget.
pub(super) fn report(maker: &LevelMaker<'_>, reduced: &Reduced, level: &Level, other: &LevelReport) -> LevelReport {
    let (budget, faces) = (other.budget, level.mesh.triangles.len() as u32);
    let whole = shape(&reduced.surface, |_| true);
    // Distances are those of the solid surface, if there is one.
    let is_clear = |material: u32| {
        let material = &maker.source.index.whole.materials[material as usize];
        material.alpha_mode == AlphaMode::Blend || material.transmission.is_some()
    };
    let solid = shape(&reduced.surface, |material| !is_clear(material));
    let deviation = maker.source.deviation_metric.measure(if solid.triangles.is_empty() { &whole } else { &solid });
    LevelReport {
        level: other.level,
        budget,
        faces,
        stopped: is_short(faces, budget).then(|| reduced.shortfall.to_string()),
        candidate: "reduction".into(),
        error: deviation.percentile_95,
        deviation,
        topology: LevelTopology::of(&whole),
        charts: 0,
        fill: 0.0,
        stretch: 0.0,
        worst_stretch: 0.0,
        clear: Vec::new(),
        lattices: cards(level),
        refined: None,
        device: None,
        likeness: None,
        warning: None,
    }
}

/// The cards of a level: all that it has with a material of its own.
fn cards(level: &Level) -> u32 {
    let own = level.layers.iter().filter(|layer| layer.material.baked().is_some());
    own.map(|layer| layer.triangles as u32 / FACES_PER_CARD).sum()
}

/// The triangles of some materials, joined where their corners coincide.
fn shape(surface: &Surface, shows: impl Fn(u32) -> bool) -> TriMesh {
    let first = first_coincident(&surface.positions);
    let triangles = surface.triangles.iter().zip(&surface.material).filter(|(_, material)| shows(**material));
    let triangles = triangles.map(|(triangle, _)| triangle.map(|v| first[v as usize])).collect();
    TriMesh { positions: surface.positions.clone(), triangles }.filtered(|_| true)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn what_one_mesh_lacks_says_nothing() {
        let triangle = LevelMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            uvs: vec![Vec2::ONE; 3],
            triangles: vec![[0, 1, 2]],
            ..LevelMesh::default()
        };
        let red = Vec4::new(1.0, 0.0, 0.0, 1.0);
        let mut mesh = LevelMesh { colors: vec![red; 3], ..triangle.clone() };
        append(&mut mesh, &LevelMesh { tangents: vec![Vec4::X; 3], ..triangle });
        assert_eq!(mesh.triangles, [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(mesh.colors, [red, red, red, Vec4::ONE, Vec4::ONE, Vec4::ONE]);
        assert_eq!(mesh.tangents, [Vec4::ZERO, Vec4::ZERO, Vec4::ZERO, Vec4::X, Vec4::X, Vec4::X]);
        assert!(mesh.second_uvs.is_empty());
        assert_eq!(mesh.validate(), Ok(()));
    }
}
