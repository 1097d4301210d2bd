//! Renders one level on the device to compare it with its views.

use glam::{Vec3, Vec4, Vec4Swizzles};
use simpliguard::Cancellation;
use simpliguard::refine::{
    BATCH, CoveredViews, DeviceError, Drawing, LeastSquares, LevelRenderer, LossTerms, LowPoly, ViewGradient,
};
use simpliguard::render::{Rect, View};
use wgpu::{Buffer, BufferUsages, ComputePass, ComputePassDescriptor};

use crate::device::GpuDevice;
use crate::error::GpuError;
use crate::frame::{Frame, Terms, VECTOR, most_tiles};
use crate::kernels::{Bindings, Slot};
use crate::level_buffers::LevelBuffers;
use crate::source_views::SourceViews;
use crate::texture_least_squares::TextureSolver;

/// A level, its views, and the buffers to render it with.
pub(crate) struct Renderer<'a> {
    pub(crate) gpu: &'a GpuDevice,
    pub(crate) views: CoveredViews<'a>,
    pub(crate) cancellation: &'a Cancellation,
    source: SourceViews,
    level: LevelBuffers,
    /// One for each view of a step, made as they are needed.
    pub(crate) frames: Vec<Frame>,
    /// Partial sums: of the tiles of each view that is scored, or of a step.
    partials: Buffer,
    /// Made with the first texture.
    pub(crate) solver: Option<TextureSolver>,
}

impl<'a> Renderer<'a> {
    pub(crate) fn new(
        gpu: &'a GpuDevice,
        low: &LowPoly,
        views: CoveredViews<'a>,
        cancellation: &'a Cancellation,
    ) -> Result<Self, GpuError> {
        let partials = VECTOR * most_tiles(views.size()) * views.views.len().max(BATCH);
        Ok(Self {
            gpu,
            cancellation,
            source: SourceViews::new(gpu, &views)?,
            level: LevelBuffers::new(gpu, low)?,
            frames: Vec::new(),
            partials: gpu.buffer("the partial sums", partials)?,
            solver: None,
            views,
        })
    }

    /// Makes `count` frames, if they are not there yet, and sends the texture if it has changed.
    pub(crate) fn update(&mut self, low: &LowPoly, count: usize) -> Result<(), GpuError> {
        while self.frames.len() < count {
            self.frames.push(Frame::new(self.gpu, low, self.views.size(), self.views.aliased)?);
        }
        self.level.update_texture(self.gpu, &low.texture.texels);
        Ok(())
    }

    /// A view, and the rectangle that the source covers in it.
    fn view(&self, view: usize) -> (&'a View, Rect) {
        (self.views.views[view], self.views.rects[view])
    }

    /// Sends what a frame needs for a view.
    pub(crate) fn prepare(&mut self, low: &LowPoly, frame: usize, view: usize, terms: Terms) {
        let view = self.view(view);
        self.source.send(self.gpu, view.0);
        self.frames[frame].prepare(self.gpu, low, view, terms);
    }

    /// All buffers for a view in a frame.
    pub(crate) fn bindings(&self, frame: usize, view: usize) -> Bindings<'_> {
        let own = [(Slot::Partials, &self.partials), (Slot::SourceView, self.source.buffer(view))];
        self.frames[frame].bindings().and(self.level.bindings()).and(own)
    }

    /// Sends the commands of one pass.
    pub(crate) fn submit(&self, record: impl FnOnce(&mut ComputePass<'_>)) -> Result<(), GpuError> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        record(&mut encoder.begin_compute_pass(&ComputePassDescriptor::default()));
        self.gpu.submit(encoder).map(drop)
    }

    /// Waits for the content of some buffers.
    pub(crate) fn read(&self, buffers: &[(&Buffer, usize)]) -> Result<Vec<u8>, GpuError> {
        let bytes = buffers.iter().map(|(_, bytes)| bytes).sum();
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let staging = self.gpu.buffer_for("the result", bytes, usage)?;
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut at = 0;
        for (buffer, bytes) in buffers {
            encoder.copy_buffer_to_buffer(buffer, 0, &staging, at, *bytes as u64);
            at += *bytes as u64;
        }
        self.gpu.read(encoder, &staging)
    }

    fn gradients(
        &mut self,
        low: &LowPoly,
        views: [usize; BATCH],
        LossTerms { background, gradient_weight }: LossTerms,
    ) -> Result<Vec<u8>, GpuError> {
        self.update(low, BATCH)?;
        let most = most_tiles(self.views.size());
        for (k, &index) in views.iter().enumerate() {
            let first_partial = (k * most) as u32;
            self.prepare(low, k, index, Terms { background, gradient_weight, first_partial, ..Terms::default() });
            let bindings = self.bindings(k, index);
            self.submit(|pass| {
                self.frames[k].render(self.gpu, pass, &bindings);
                self.frames[k].backward(self.gpu, pass, &bindings);
            })?;
        }
        let gradients = self.frames.iter().filter_map(|frame| frame.buffer(Slot::VertexGradients));
        let mut wanted: Vec<(&Buffer, usize)> =
            gradients.map(|buffer| (buffer, VECTOR * low.positions.len())).collect();
        wanted.push((&self.partials, VECTOR * most * BATCH));
        self.read(&wanted)
    }

    fn try_differentiate(
        &mut self,
        low: &LowPoly,
        views: [usize; BATCH],
        terms: LossTerms,
        gradients: &mut [ViewGradient; BATCH],
    ) -> Result<(), GpuError> {
        let bytes = self.gradients(low, views, terms)?;
        let vectors: &[Vec4] = &bytemuck::pod_collect_to_vec(&bytes);
        let (clip, partials) = vectors.split_at(BATCH * low.positions.len());
        let (size, most) = (self.views.size(), most_tiles(self.views.size()));
        for (k, out) in gradients.iter_mut().enumerate() {
            let tiles = &partials[k * most..k * most + self.frames[k].tiles()];
            out.loss = tiles.iter().map(|sum| f64::from(sum.x)).sum::<f64>() / (size * size) as f64;
            to_world(low, self.view(views[k]).0, &clip[k * low.positions.len()..], out);
        }
        Ok(())
    }

    fn try_errors(&mut self, low: &LowPoly) -> Result<Vec<f64>, GpuError> {
        self.update(low, 1)?;
        let most = most_tiles(self.views.size());
        let mut tiles = Vec::new();
        for index in (0..self.views.views.len()).take_while(|_| !self.cancellation.is_cancelled()) {
            self.prepare(low, 0, index, Terms { first_partial: (index * most) as u32, ..Terms::default() });
            tiles.push(self.frames[0].tiles());
            let (frame, bindings) = (&self.frames[0], self.bindings(0, index));
            self.submit(|pass| match self.views.aliased {
                true => frame.squared_errors_of_means(self.gpu, pass, &bindings),
                false => frame.squared_errors(self.gpu, pass, &bindings),
            })?;
        }
        let bytes = self.read(&[(&self.partials, VECTOR * most * tiles.len())])?;
        let sums: Vec<Vec4> = bytemuck::pod_collect_to_vec(&bytes);
        let side = if self.views.aliased { self.views.size() / 2 } else { self.views.size() };
        let pixels = (3 * side.pow(2)) as f64;
        let error = |(view, tiles): (usize, usize)| {
            let sums = sums[view * most..view * most + tiles].iter();
            0.5 * sums.map(|sum| f64::from(sum.x) + f64::from(sum.y)).sum::<f64>() / pixels
        };
        Ok(tiles.into_iter().enumerate().map(error).collect())
    }

    fn try_draw(&mut self, low: &LowPoly, index: usize) -> Result<Drawing, GpuError> {
        self.update(low, 1)?;
        let size = self.views.size();
        let (view, _) = self.view(index);
        self.frames[0].prepare(self.gpu, low, (view, Rect { x0: 0, y0: 0, x1: size, y1: size }), Terms::default());
        let bindings = self.bindings(0, index);
        self.submit(|pass| self.frames[0].render(self.gpu, pass, &bindings))?;
        let sizes = [(Slot::Ids, 4), (Slot::Image, VECTOR)];
        let frame = &self.frames[0];
        let wanted: Vec<(&Buffer, usize)> =
            sizes.iter().filter_map(|(slot, bytes)| Some((frame.buffer(*slot)?, bytes * size * size))).collect();
        let bytes = self.read(&wanted)?;
        let (ids, colors) = bytes.split_at(4 * size * size);
        Ok(Drawing { ids: bytemuck::pod_collect_to_vec(ids), colors: bytemuck::pod_collect_to_vec(colors) })
    }
}

/// From gradients in clip space (x, y, w) to those in world space, in the pose of the view and at rest.
fn to_world(low: &LowPoly, view: &View, clip: &[Vec4], out: &mut ViewGradient) {
    let transposed = view.camera.view_projection.transpose();
    let to_world = |g: &Vec4| (transposed * Vec4::new(g.x, g.y, 0.0, g.z)).xyz();
    out.posed.clear();
    out.posed.extend(clip.iter().take(low.positions.len()).map(to_world));
    out.positions.clone_from(&out.posed);
    if let Some(motions) = low.motions.of(view.pose) {
        let turn_back = |(gradient, motion): (&mut Vec3, &glam::Affine3A)| {
            *gradient = motion.matrix3.transpose() * *gradient;
        };
        out.positions.iter_mut().zip(motions).for_each(turn_back);
    }
}

impl LevelRenderer for Renderer<'_> {
    type Error = DeviceError;

    fn differentiate(
        &mut self,
        low: &LowPoly,
        views: [usize; BATCH],
        loss: LossTerms,
        gradients: &mut [ViewGradient; BATCH],
    ) -> Result<(), DeviceError> {
        Ok(self.try_differentiate(low, views, loss, gradients)?)
    }

    fn errors(&mut self, low: &LowPoly) -> Result<Vec<f64>, DeviceError> {
        Ok(self.try_errors(low)?)
    }

    fn solve_texture(&mut self, low: &mut LowPoly, terms: LeastSquares<'_>) -> Result<(), DeviceError> {
        Ok(self.try_solve_texture(low, terms)?)
    }

    fn draw(&mut self, low: &LowPoly, view: usize) -> Result<Drawing, DeviceError> {
        Ok(self.try_draw(low, view)?)
    }
}
