//! The buffers of one view, and the kernels that draw it.

use bytemuck::{Pod, Zeroable};
use glam::Vec4;
use simpliguard::refine::LowPoly;
use simpliguard::render::{Rect, View, to_pixels};
use wgpu::{Buffer, BufferUsages, ComputePass};

use crate::device::GpuDevice;
use crate::error::GpuError;
use crate::kernels::{Bindings, Slot, TILE, groups};

/// The terms of the work on a view. Each kernel uses some of them.
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Terms {
    pub(crate) background: f32,
    pub(crate) gradient_weight: f32,
    pub(crate) smoothness: f32,
    /// Where the partial sums of the view begin.
    pub(crate) first_partial: u32,
    /// Every so many-th row and column of pixels counts in the texture, each pixel with a weight from 0 to 1.
    pub(crate) pixel_stride: u32,
    pub(crate) pixel_weight: f32,
    /// Side of the coarse texture, zero without one, and the error at which a pixel counts half.
    pub(crate) coarse_size: u32,
    pub(crate) trust: f32,
}

/// The parameters as the shaders have them.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Params {
    rect: [u32; 4],
    first_tile: [u32; 2],
    tiles_in_row: u32,
    double_sided: u32,
    size: u32,
    texture_size: u32,
    vertices: u32,
    triangles: u32,
    terms: Terms,
}

/// A vertex as the shaders have it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Vertex {
    clip: [f32; 4],
    pixel: [f32; 4],
}

/// Bytes of a triangle that is set up.
const SETUP: usize = 96;
/// Bytes of a vector of four.
pub(crate) const VECTOR: usize = 16;

/// Buffers of one view, reused from view to view.
pub(crate) struct Frame {
    params: Buffer,
    vertices: Buffer,
    buffers: Vec<(Slot, Buffer)>,
    /// Tiles that the kernels for pixels work on.
    tiles: [u32; 2],
    triangles: usize,
    positions: usize,
    /// Positions in clip space.
    clip: Vec<Vec4>,
}

/// The number of tiles of a view, at most.
pub(crate) fn most_tiles(size: usize) -> usize {
    size.div_ceil(TILE).pow(2)
}

impl Frame {
    /// For views of `size` x `size` pixels. There is no gradient of `aliased` ones.
    pub(crate) fn new(gpu: &GpuDevice, low: &LowPoly, size: usize, aliased: bool) -> Result<Self, GpuError> {
        let (pixels, triangles, positions) = (size * size, low.triangles.len(), low.positions.len());
        let buffer = |slot, what, bytes| Ok::<_, GpuError>((slot, gpu.buffer(what, bytes)?));
        let mut buffers = vec![
            buffer(Slot::Setups, "the set-up of the triangles", SETUP * triangles)?,
            buffer(Slot::Ids, "the visible triangles", 4 * pixels)?,
            buffer(Slot::Depth, "the depths", 4 * pixels)?,
            buffer(Slot::Base, "the colours", VECTOR * pixels)?,
            buffer(Slot::Reach, "the reach of the silhouettes", 4 * 4 * pixels)?,
            buffer(Slot::Edges, "the edges of the silhouettes", 4 * 4 * pixels)?,
            buffer(Slot::Image, "the image", VECTOR * pixels)?,
        ];
        if !aliased {
            buffers.extend([
                buffer(Slot::Residual, "the residual", VECTOR * pixels)?,
                buffer(Slot::ImageGradient, "the gradient at the image", VECTOR * pixels)?,
                buffer(Slot::BaseGradient, "the gradient at the colours", VECTOR * pixels)?,
                buffer(Slot::CornerGradients, "the gradients at the corners", 3 * VECTOR * triangles)?,
                buffer(Slot::EndGradients, "the gradients at the edges", 6 * VECTOR * triangles)?,
                buffer(Slot::VertexGradients, "the gradients at the vertices", VECTOR * positions)?,
            ]);
        }
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Ok(Self {
            params: gpu.buffer_for("the parameters", size_of::<Params>(), usage)?,
            vertices: gpu.buffer("the vertices", size_of::<Vertex>() * positions)?,
            buffers,
            tiles: [0; 2],
            triangles,
            positions,
            clip: Vec::new(),
        })
    }

    /// The buffer in a slot.
    pub(crate) fn buffer(&self, slot: Slot) -> Option<&Buffer> {
        self.buffers.iter().find(|(own, _)| *own == slot).map(|(_, buffer)| buffer)
    }

    /// The buffers in their slots.
    pub(crate) fn bindings(&self) -> Bindings<'_> {
        let own = [(Slot::Params, &self.params), (Slot::Vertices, &self.vertices)];
        Bindings::new(self.buffers.iter().map(|(slot, buffer)| (*slot, buffer))).and(own)
    }

    /// Sends the vertices and the parameters of a view. `source` is the rectangle that the source covers.
    pub(crate) fn prepare(&mut self, gpu: &GpuDevice, low: &LowPoly, (view, source): (&View, Rect), terms: Terms) {
        let size = view.image.size;
        low.motions.project(&low.positions, &view.camera.view_projection, view.pose, &mut self.clip);
        let vertex =
            |clip: &Vec4| Vertex { clip: clip.to_array(), pixel: to_pixels(*clip, size).extend(0.0).to_array() };
        let vertices: Vec<Vertex> = self.clip.iter().map(vertex).collect();
        gpu.queue.write_buffer(&self.vertices, 0, bytemuck::cast_slice(&vertices));
        let own = Rect::around(&self.clip, size, 2);
        let (x0, y0) = (own.x0.min(source.x0), own.y0.min(source.y0));
        let (x1, y1) = (own.x1.max(source.x1), own.y1.max(source.y1));
        let tiles = |first: usize, end: usize| (end.div_ceil(TILE)).saturating_sub(first / TILE) as u32;
        self.tiles = [tiles(x0, x1), tiles(y0, y1)];
        let params = Params {
            rect: [x0, y0, x1, y1].map(|x| x as u32),
            first_tile: [x0, y0].map(|x| (x / TILE) as u32),
            tiles_in_row: self.tiles[0],
            size: size as u32,
            texture_size: low.texture.size as u32,
            vertices: self.positions as u32,
            triangles: self.triangles as u32,
            double_sided: low.double_sided.into(),
            terms,
        };
        gpu.queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
    }

    /// Number of tiles of the view that was prepared.
    pub(crate) fn tiles(&self) -> usize {
        (self.tiles[0] * self.tiles[1]) as usize
    }

    /// Finds visibility alone.
    fn rasterise(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        gpu.kernels.set_up.run(pass, &gpu.device, bindings, groups(self.triangles, 64));
        gpu.kernels.rasterise.run(pass, &gpu.device, bindings, self.tiles);
    }

    /// Finds visibility, and the blends across silhouettes.
    fn find_visible(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        let (device, kernels) = (&gpu.device, &gpu.kernels);
        self.rasterise(gpu, pass, bindings);
        kernels.clear_blends.run(pass, device, bindings, self.tiles);
        for pass_of_find in &gpu.passes_of_find {
            let bindings = bindings.and([(Slot::PassOfFind, pass_of_find)]);
            kernels.find_blends.run(pass, device, &bindings, groups(3 * self.triangles, 64));
        }
    }

    /// Runs the whole forward pass.
    pub(crate) fn render(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        self.find_visible(gpu, pass, bindings);
        gpu.kernels.shade.run(pass, &gpu.device, bindings, self.tiles);
        gpu.kernels.blend.run(pass, &gpu.device, bindings, self.tiles);
    }

    /// Draws the view and sums up the squared errors of each tile.
    pub(crate) fn squared_errors(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        self.render(gpu, pass, bindings);
        gpu.kernels.squared_errors.run(pass, &gpu.device, bindings, self.tiles);
    }

    /// The same without antialiasing, of the means of four pixels.
    pub(crate) fn squared_errors_of_means(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        let (device, kernels) = (&gpu.device, &gpu.kernels);
        self.rasterise(gpu, pass, bindings);
        kernels.shade.run(pass, device, bindings, self.tiles);
        kernels.squared_errors_of_means.run(pass, device, bindings, self.tiles);
    }

    /// Adds the pixels of the view to the normal equations of the texture.
    pub(crate) fn assemble(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        self.find_visible(gpu, pass, bindings);
        gpu.kernels.assemble.run(pass, &gpu.device, bindings, self.tiles);
    }

    /// Finds the image loss, and carries its gradient back to the vertices.
    pub(crate) fn backward(&self, gpu: &GpuDevice, pass: &mut ComputePass<'_>, bindings: &Bindings<'_>) {
        let (device, kernels) = (&gpu.device, &gpu.kernels);
        kernels.find_residual.run(pass, device, bindings, self.tiles);
        kernels.image_loss.run(pass, device, bindings, self.tiles);
        kernels.backward_blends.run(pass, device, bindings, self.tiles);
        kernels.backward_shading.run(pass, device, bindings, groups(self.triangles, 1));
        kernels.backward_edges.run(pass, device, bindings, groups(3 * self.triangles, 64));
        kernels.gather_vertices.run(pass, device, bindings, groups(self.positions, 64));
    }
}
