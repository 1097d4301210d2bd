//! Levels by meshoptimizer: edge collapse of the source's own mesh. Vertices keep their attributes, and materials their
//! textures.

use std::collections::HashMap;
use std::error::Error;

use meshopt::{SimplifyOptions, VertexDataAdapter, simplify_with_attributes_and_locks};
use simpliguard::data::{Model, Surface};

/// Weight of the normals beside the positions, as in gltfpack.
const NORMAL_WEIGHT: f32 = 0.5;
/// Weight of vertex colours.
const COLOR_WEIGHT: f32 = 1.0;
/// Weight of texture coordinates, where one is the whole texture.
const UV_WEIGHT: f32 = 1.0;
/// A result with more than this many times the budget has missed it.
const MISSED: f64 = 1.05;

/// The source with at most `budget` triangles, if meshoptimizer reaches that.
pub(crate) fn collapse(source: &Model, budget: usize) -> Result<Model, Box<dyn Error>> {
    let surface = by_material(&source.surface);
    // Seams of the texture are kept where the budget allows it.
    let options = [SimplifyOptions::Prune, SimplifyOptions::Prune | SimplifyOptions::Permissive];
    let mut kept = Vec::new();
    for options in options {
        kept = simplified(&surface, budget, options)?;
        if kept.len() as f64 <= MISSED * budget as f64 {
            break;
        }
    }
    let mut material_of = vec![0; surface.positions.len()];
    for (triangle, &material) in surface.triangles.iter().zip(&surface.material) {
        triangle.iter().for_each(|&v| material_of[v as usize] = material);
    }
    let material = kept.iter().map(|triangle| material_of[triangle[0] as usize]).collect();
    let surface = Surface { triangles: kept, material, ..surface };
    Ok(source.with_surface(surface, source.materials.clone()))
}

fn simplified(surface: &Surface, budget: usize, options: SimplifyOptions) -> Result<Vec<[u32; 3]>, Box<dyn Error>> {
    let positions: &[u8] = bytemuck::cast_slice(&surface.positions);
    let vertices = VertexDataAdapter::new(positions, size_of::<glam::Vec3>(), 0)?;
    let (attributes, weights) = attributes(surface);
    let indices: &[u32] = surface.triangles.as_flattened();
    let locks = vec![false; surface.positions.len()];
    let stride = weights.len() * size_of::<f32>();
    let kept = simplify_with_attributes_and_locks(
        indices,
        &vertices,
        &attributes,
        &weights,
        stride,
        &locks,
        3 * budget,
        f32::MAX,
        options,
        None,
    );
    Ok(kept.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect())
}

/// Normals, vertex colours and texture coordinates side by side, and the weight of each number.
fn attributes(surface: &Surface) -> (Vec<f32>, Vec<f32>) {
    let mut weights = vec![NORMAL_WEIGHT; 3];
    if !surface.colors.is_empty() {
        weights.extend([COLOR_WEIGHT; 4]);
    }
    if !surface.uvs[0].is_empty() {
        weights.extend([UV_WEIGHT; 2]);
    }
    let of = |v: usize| {
        let colors = surface.colors.get(v).map(|color| color.to_array());
        let uvs = surface.uvs[0].get(v).map(|uv| uv.to_array());
        let normal = surface.normals[v].to_array().into_iter();
        normal.chain(colors.into_iter().flatten()).chain(uvs.into_iter().flatten())
    };
    ((0..surface.positions.len()).flat_map(of).collect(), weights)
}

/// The surface with vertices of its own for each material, so that a vertex tells the material of its triangles.
fn by_material(surface: &Surface) -> Surface {
    let mut sources: Vec<u32> = Vec::new();
    let mut new_index: HashMap<(u32, u32), u32> = HashMap::new();
    let mut index = |v: u32, material: u32| {
        *new_index.entry((v, material)).or_insert_with(|| {
            sources.push(v);
            sources.len() as u32 - 1
        })
    };
    let corners = surface.triangles.iter().zip(&surface.material);
    let triangles: Vec<[u32; 3]> = corners.map(|(t, &material)| t.map(|v| index(v, material))).collect();
    Surface {
        positions: taken(&surface.positions, &sources),
        normals: taken(&surface.normals, &sources),
        tangents: taken(&surface.tangents, &sources),
        uvs: [taken(&surface.uvs[0], &sources), taken(&surface.uvs[1], &sources)],
        colors: taken(&surface.colors, &sources),
        triangles,
        material: surface.material.clone(),
        ..Surface::default()
    }
}

/// The elements with these indices; an empty array stays empty.
fn taken<T: Copy>(all: &[T], indices: &[u32]) -> Vec<T> {
    if all.is_empty() { Vec::new() } else { indices.iter().map(|&v| all[v as usize]).collect() }
}
