//! What stays on the device for all steps of a level: triangles and texture.

use bytemuck::{Pod, Zeroable};
use glam::Vec4;
use simpliguard::refine::{LowPoly, TexelGrid};
use wgpu::Buffer;

use crate::device::GpuDevice;
use crate::error::GpuError;
use crate::kernels::Slot;

/// A triangle as the shaders have it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Triangle {
    vertices: [u32; 3],
    neighbours: [u32; 3],
    uvs: [[f32; 2]; 3],
}

/// The buffers of a level.
pub(crate) struct LevelBuffers {
    triangles: Buffer,
    /// See `incidence` in the shaders.
    incidence: Buffer,
    covered: Buffer,
    texels: Buffer,
    /// The texels that are on the device.
    sent: Vec<Vec4>,
}

impl LevelBuffers {
    pub(crate) fn new(gpu: &GpuDevice, low: &LowPoly) -> Result<Self, GpuError> {
        let triangle = |t: usize| Triangle {
            vertices: low.triangles[t],
            neighbours: low.neighbours[t],
            uvs: low.uvs[t].map(|uv| uv.to_array()),
        };
        let triangles: Vec<Triangle> = (0..low.triangles.len()).map(triangle).collect();
        let TexelGrid { covered, texels, .. } = &low.texture;
        let covered: Vec<u32> = covered.iter().map(|&covered| u32::from(covered)).collect();
        Ok(Self {
            triangles: gpu.buffer_of("the triangles", &triangles)?,
            incidence: gpu.buffer_of("the corners of the vertices", &incidence(low))?,
            covered: gpu.buffer_of("the coverage of the texture", &covered)?,
            texels: gpu.buffer_of("the texture", texels)?,
            sent: texels.clone(),
        })
    }

    /// Sends the texture, if it has changed. A comparison is cheaper than the transfer.
    pub(crate) fn update_texture(&mut self, gpu: &GpuDevice, texels: &[Vec4]) {
        if self.sent != texels {
            self.sent.copy_from_slice(texels);
            gpu.queue.write_buffer(&self.texels, 0, bytemuck::cast_slice(texels));
        }
    }

    /// The buffers that all kernels may use.
    pub(crate) fn bindings(&self) -> [(Slot, &Buffer); 4] {
        [
            (Slot::Triangles, &self.triangles),
            (Slot::Incidence, &self.incidence),
            (Slot::Covered, &self.covered),
            (Slot::Texels, &self.texels),
        ]
    }
}

/// Where the corners of each vertex begin, then the corners. Corner `k` of triangle `t` is `3 t + k`.
fn incidence(low: &LowPoly) -> Vec<u32> {
    let corners = low.triangles.as_flattened();
    let first = low.positions.len() as u32 + 1;
    let mut starts = vec![0_u32; first as usize];
    corners.iter().for_each(|&v| starts[v as usize + 1] += 1);
    starts[0] = first;
    (1..starts.len()).for_each(|v| starts[v] += starts[v - 1]);
    let mut next = starts.clone();
    let mut incidence = starts;
    incidence.resize(first as usize + corners.len(), 0);
    for (corner, &v) in corners.iter().enumerate() {
        incidence[next[v as usize] as usize] = corner as u32;
        next[v as usize] += 1;
    }
    incidence
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use simpliguard::data::{Atlas, TriMesh};

    use super::*;

    #[test]
    fn each_vertex_has_its_corners_in_their_order() {
        let mesh = TriMesh { positions: vec![Vec3::ZERO; 4], triangles: vec![[0, 1, 2], [2, 1, 3]] };
        let atlas = Atlas { uvs: vec![[Vec2::ZERO; 3]; 2], ..Atlas::default() };
        let low = LowPoly::new(&mesh, &atlas, false, TexelGrid::empty());
        assert_eq!(incidence(&low), [5, 6, 8, 10, 11, 0, 1, 4, 2, 3, 5]);
    }
}
