//! The views of the source on the device.

use simpliguard::refine::CoveredViews;
use simpliguard::render::View;
use wgpu::Buffer;

use crate::device::GpuDevice;
use crate::error::GpuError;

/// The pixels of the views.
pub(crate) enum SourceViews {
    /// A buffer for each, for views that are compared again and again.
    Resident(Vec<Buffer>),
    /// One that each is sent to when it is needed. Views without antialiasing have four times the pixels, and are needed twice.
    Streamed(Buffer),
}

impl SourceViews {
    pub(crate) fn new(gpu: &GpuDevice, views: &CoveredViews<'_>) -> Result<Self, GpuError> {
        if views.aliased {
            return Ok(Self::Streamed(gpu.buffer("a view", size_of::<[u8; 4]>() * views.size() * views.size())?));
        }
        let buffer = |view: &&View| gpu.buffer_of("a view", &view.image.pixels);
        Ok(Self::Resident(views.views.iter().map(buffer).collect::<Result<_, _>>()?))
    }

    /// Sends a view for the work that is submitted next.
    pub(crate) fn send(&self, gpu: &GpuDevice, view: &View) {
        if let Self::Streamed(buffer) = self {
            gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&view.image.pixels));
        }
    }

    /// The buffer of a view.
    pub(crate) fn buffer(&self, view: usize) -> &Buffer {
        match self {
            Self::Resident(buffers) => &buffers[view],
            Self::Streamed(buffer) => buffer,
        }
    }
}
