//! The solid surface of a source: its triangles without those that are cut out nearly everywhere.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use crate::data::{AlphaMode, TriMesh};
use crate::geometry::Bvh;
use crate::render::{Footprint, SurfaceSampler};

/// Least fraction of a masked triangle that is not cut out.
const OPACITY: f32 = 0.25;
/// Barycentric coordinates of the points of a triangle at which its opacity is sampled.
const POINTS: [[f32; 3]; 7] = [
    [0.34, 0.33, 0.33],
    [0.8, 0.1, 0.1],
    [0.1, 0.8, 0.1],
    [0.1, 0.1, 0.8],
    [0.45, 0.45, 0.1],
    [0.45, 0.1, 0.45],
    [0.1, 0.45, 0.45],
];

/// A source's triangles without those that are cut out nearly everywhere. If all are, all are kept.
pub struct OpaqueSurface {
    /// The triangles.
    pub mesh: TriMesh,
    /// Over the triangles of `mesh`.
    pub bvh: Arc<Bvh>,
    /// Index of each triangle in the source.
    pub source: Vec<u32>,
    /// Fraction of each triangle that is not cut out, 0 to 1.
    pub opacity: Vec<f32>,
}

impl OpaqueSurface {
    /// Sorts out the triangles of the sampled model that are cut out. `whole` is the hierarchy over all of its triangles.
    pub fn of(sampler: &SurfaceSampler<'_>, whole: &Arc<Bvh>) -> Self {
        let surface = &sampler.model().surface;
        let all: Vec<u32> = (0..surface.triangles.len() as u32).collect();
        let opacity: Vec<f32> = all.par_iter().map(|&t| opacity(sampler, t as usize)).collect();
        let opaque: Vec<u32> = all.iter().copied().filter(|&t| opacity[t as usize] >= OPACITY).collect();
        let source = if opaque.is_empty() { all } else { opaque };
        let triangles = source.iter().map(|&t| surface.triangles[t as usize]).collect();
        let opacity = source.iter().map(|&t| opacity[t as usize]).collect();
        let mesh = TriMesh { positions: surface.positions.clone(), triangles };
        let is_whole = source.len() == surface.triangles.len();
        let bvh = if is_whole { whole.clone() } else { Bvh::new(&mesh.positions, &mesh.triangles).into() };
        Self { bvh, mesh, source, opacity }
    }
}

/// Fraction of a triangle that is not cut out, from a few points of it.
fn opacity(sampler: &SurfaceSampler<'_>, t: usize) -> f32 {
    let AlphaMode::Mask { cutoff } = sampler.material(t).alpha_mode else { return 1.0 };
    let footprint = Footprint::new(0.1, 1.0);
    let is_there = |b: &&[f32; 3]| sampler.color(t, Vec3::from(**b), footprint).w >= cutoff;
    POINTS.iter().filter(is_there).count() as f32 / POINTS.len() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Material, Model, Surface};
    use glam::Vec4;

    fn model(alphas: &[f32], alpha_mode: AlphaMode) -> Model {
        let material =
            |&a: &f32| Material { base_color: Vec4::new(1.0, 1.0, 1.0, a), alpha_mode, ..Material::default() };
        let surface = Surface {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            triangles: vec![[0, 1, 2]; alphas.len()],
            material: (0..alphas.len() as u32).collect(),
            ..Surface::default()
        };
        Model { surface, materials: alphas.iter().map(material).collect(), ..Model::empty("leaves") }
    }

    fn opaque(model: &Model) -> OpaqueSurface {
        let bvh = Bvh::new(&model.surface.positions, &model.surface.triangles);
        OpaqueSurface::of(&SurfaceSampler::new(model), &bvh.into())
    }

    #[test]
    fn triangles_that_are_cut_out_are_left_out() {
        let model = model(&[0.1, 1.0, 0.6], AlphaMode::Mask { cutoff: 0.5 });
        let opaque = opaque(&model);
        assert_eq!((opaque.source, opaque.opacity), (vec![1, 2], vec![1.0; 2]));
    }

    #[test]
    fn clear_triangles_and_a_model_that_is_cut_out_as_a_whole_are_kept() {
        for (alphas, alpha_mode) in [([0.1, 0.6], AlphaMode::Blend), ([0.1, 0.05], AlphaMode::Mask { cutoff: 0.5 })] {
            let model = model(&alphas, alpha_mode);
            assert_eq!(opaque(&model).source, [0, 1]);
        }
    }
}
