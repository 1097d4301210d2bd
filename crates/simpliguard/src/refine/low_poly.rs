use std::collections::HashMap;

use glam::{Vec2, Vec3, Vec4};

use crate::animation::Motions;
use crate::data::image::{halved, mean};
use crate::data::{Atlas, TriMesh};
use crate::render::fill_unknown;

/// Alpha at which a cut-out begins.
pub(super) const CUTOFF: f32 = 0.5;
/// Marks an edge that no other triangle shares.
pub const NO_NEIGHBOUR: u32 = u32::MAX;

/// A square texture that is fitted to the views.
#[derive(Clone, Debug)]
pub struct TexelGrid {
    /// Side in texels.
    pub size: usize,
    /// sRGB-encoded colours, rows from the top; the fourth slot is one.
    pub texels: Vec<Vec4>,
    /// Texels that some triangle covers.
    pub covered: Vec<bool>,
    /// Alpha of each texel, 0 to 1; below 0.5 nothing is drawn. Empty if everything is.
    pub opacity: Vec<f32>,
}

impl TexelGrid {
    /// Stands for a texture that is not made yet. A mesh with it cannot be rendered.
    pub fn empty() -> Self {
        Self { size: 1, texels: Vec::new(), covered: Vec::new(), opacity: Vec::new() }
    }

    /// Gives texels that no triangle covers the alpha of their neighbours, as the finished texture has them.
    pub fn fill_opacity(&mut self) {
        let mut filled: Vec<Vec4> = self.opacity.iter().map(|&opacity| Vec4::splat(opacity)).collect();
        fill_unknown(&mut filled, &self.covered, self.size);
        self.opacity.iter_mut().zip(filled).for_each(|(opacity, filled)| *opacity = filled.x);
    }

    /// The same texture at half the size, each texel the mean of four.
    fn halved(&self) -> Self {
        let size = [self.size; 2];
        let covered = halved(&self.covered, size, |four| four.contains(&true));
        let opacity = match self.opacity.is_empty() {
            true => Vec::new(),
            false => halved(&self.opacity, size, |four| 0.25 * four.iter().sum::<f32>()),
        };
        Self { size: self.size / 2, texels: halved(&self.texels, size, mean), covered, opacity }
    }
}

/// A textured low-poly mesh, as the differentiable renderer sees it.
#[derive(Clone, Debug)]
pub struct LowPoly {
    /// World space; moved by the optimisation.
    pub positions: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Texture coordinates of each corner in texels, origin top left, centre of the first texel at 0.5.
    pub uvs: Vec<[Vec2; 3]>,
    /// Triangle across edge `k` (corners `k` and `k + 1`), or [`NO_NEIGHBOUR`].
    pub neighbours: Vec<[u32; 3]>,
    /// Back faces are drawn.
    pub double_sided: bool,
    /// Fitted to the views.
    pub texture: TexelGrid,
    /// How the vertices move into the poses of the views.
    pub motions: Motions,
}

impl LowPoly {
    /// A mesh with its atlas and an initial texture.
    pub fn new(mesh: &TriMesh, atlas: &Atlas, double_sided: bool, texture: TexelGrid) -> Self {
        Self {
            positions: mesh.positions.clone(),
            triangles: mesh.triangles.clone(),
            uvs: uvs_in_texels(atlas, texture.size),
            neighbours: neighbours(&mesh.triangles),
            double_sided,
            texture,
            motions: Motions::default(),
        }
    }

    /// The same mesh with other motions.
    pub fn with_motions(self, motions: Motions) -> Self {
        Self { motions, ..self }
    }

    /// The same mesh with another texture.
    pub fn retextured(self, atlas: &Atlas, texture: TexelGrid) -> Self {
        Self { uvs: uvs_in_texels(atlas, texture.size), texture, ..self }
    }

    /// The same mesh with its texture at half the size.
    pub(super) fn halved(&self) -> Self {
        let uvs = self.uvs.iter().map(|corners| corners.map(|uv| uv * 0.5)).collect();
        Self { uvs, texture: self.texture.halved(), ..self.clone() }
    }

    /// The mesh alone.
    pub fn mesh(&self) -> TriMesh {
        TriMesh { positions: self.positions.clone(), triangles: self.triangles.clone() }
    }

    /// The corners of triangle `t`.
    pub(super) fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.positions[v as usize])
    }

    /// Mean length of the triangles' sides.
    pub(super) fn mean_edge(&self) -> f32 {
        let side =
            |t: &[u32; 3], k: usize| self.positions[t[k] as usize].distance(self.positions[t[(k + 1) % 3] as usize]);
        let sum: f32 = self.triangles.iter().map(|t| side(t, 0) + side(t, 1) + side(t, 2)).sum();
        sum / (3 * self.triangles.len()).max(1) as f32
    }
}

fn uvs_in_texels(atlas: &Atlas, size: usize) -> Vec<[Vec2; 3]> {
    atlas.uvs.iter().map(|corners| corners.map(|uv| uv * size as f32)).collect()
}

fn neighbours(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut owner = HashMap::with_capacity(triangles.len() * 3);
    for (t, triangle) in triangles.iter().enumerate() {
        for k in 0..3 {
            owner.insert((triangle[k], triangle[(k + 1) % 3]), t as u32);
        }
    }
    let across = |t: &[u32; 3], k: usize| owner.get(&(t[(k + 1) % 3], t[k])).copied().unwrap_or(NO_NEIGHBOUR);
    triangles.iter().map(|t| [across(t, 0), across(t, 1), across(t, 2)]).collect()
}
