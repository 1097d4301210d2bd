use std::collections::HashMap;

use glam::{Vec2, Vec3, Vec4};

use crate::animation::Motions;
use crate::data::{Atlas, TriMesh};

/// No triangle lies across an edge.
pub(super) const NO_NEIGHBOUR: u32 = u32::MAX;

/// A textured low-poly mesh, as the differentiable renderer sees it.
#[derive(Clone, Debug)]
pub struct LowPoly {
    /// World space; what descent moves.
    pub positions: Vec<Vec3>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Texture coordinates of each corner in texels, origin top left, centre of the first texel at 0.5.
    pub uvs: Vec<[Vec2; 3]>,
    /// Triangle across edge `k` (corners `k` and `k + 1`), or `NO_NEIGHBOUR`.
    pub(super) neighbours: Vec<[u32; 3]>,
    /// Back faces are drawn.
    pub double_sided: bool,
    /// Side of the texture.
    pub size: usize,
    /// Encoded RGB, rows from the top; the fourth slot is one.
    pub texels: Vec<Vec4>,
    /// Texels that some triangle covers.
    pub covered: Vec<bool>,
    /// How the vertices move into the poses of the views.
    pub motions: Motions,
}

impl LowPoly {
    /// A mesh with its atlas and an initial texture of `size` x `size` texels.
    pub fn new(
        mesh: &TriMesh,
        atlas: &Atlas,
        double_sided: bool,
        size: usize,
        texels: Vec<Vec4>,
        covered: Vec<bool>,
    ) -> Self {
        Self {
            positions: mesh.positions.clone(),
            triangles: mesh.triangles.clone(),
            uvs: atlas.uvs.iter().map(|corners| corners.map(|uv| uv * size as f32)).collect(),
            neighbours: neighbours(&mesh.triangles),
            double_sided,
            size,
            texels,
            covered,
            motions: Motions::default(),
        }
    }

    /// The same mesh on its bones.
    pub fn with_motions(self, motions: Motions) -> Self {
        Self { motions, ..self }
    }

    /// The same mesh with another texture of `size` x `size` texels.
    pub fn retextured(self, atlas: &Atlas, size: usize, texels: Vec<Vec4>, covered: Vec<bool>) -> Self {
        let uvs = atlas.uvs.iter().map(|corners| corners.map(|uv| uv * size as f32)).collect();
        Self { uvs, size, texels, covered, ..self }
    }

    /// The same mesh with its texture at half the size, each texel the mean of four.
    pub(super) fn halved(&self) -> Self {
        let size = self.size / 2;
        let four = |i: usize| {
            let k = 2 * (i / size * self.size + i % size);
            [k, k + 1, k + self.size, k + self.size + 1]
        };
        let texels = (0..size * size).map(|i| four(i).map(|k| self.texels[k]).iter().sum::<Vec4>() * 0.25).collect();
        let covered = (0..size * size).map(|i| four(i).iter().any(|&k| self.covered[k])).collect();
        let uvs = self.uvs.iter().map(|corners| corners.map(|uv| uv * 0.5)).collect();
        Self { uvs, size, texels, covered, ..self.clone() }
    }

    /// The mesh alone.
    pub fn mesh(&self) -> TriMesh {
        TriMesh { positions: self.positions.clone(), triangles: self.triangles.clone() }
    }

    /// Mean length of the triangles' sides.
    pub(super) fn mean_edge(&self) -> f32 {
        let side =
            |t: &[u32; 3], k: usize| self.positions[t[k] as usize].distance(self.positions[t[(k + 1) % 3] as usize]);
        let sum: f32 = self.triangles.iter().map(|t| side(t, 0) + side(t, 1) + side(t, 2)).sum();
        sum / (3 * self.triangles.len()).max(1) as f32
    }
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
