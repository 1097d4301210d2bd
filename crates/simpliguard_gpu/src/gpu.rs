//! A GPU as a backend of the refine stage.

use std::time::Duration;

use simpliguard::Cancellation;
use simpliguard::refine::{Backend, CoveredViews, DeviceError, LevelRenderer, LowPoly};

use crate::adapter::Choice;
use crate::device::GpuDevice;
use crate::error::GpuError;
use crate::frame::VECTOR;
use crate::renderer::Renderer;
use crate::self_test;
use crate::texture_least_squares::SUMS;

/// A GPU that refines levels. All levels and threads of a program share it.
pub struct Gpu(GpuDevice);

impl Gpu {
    /// Opens the best GPU of the machine. It must draw a test scene as the CPU does.
    ///
    /// # Errors
    /// If there is none, or if it cannot be used.
    pub fn open(choice: Choice) -> Result<Self, GpuError> {
        let gpu = Self(GpuDevice::open(choice)?);
        let name = gpu.name();
        self_test::run(&gpu).map_err(|found| GpuError::Unsuitable { name: name.to_owned(), found })?;
        tracing::info!(name, "levels are refined on a GPU");
        Ok(gpu)
    }

    /// True once the device has failed. It is of no use after that.
    pub fn is_lost(&self) -> bool {
        self.0.check().is_err()
    }

    /// Limits the work of the device in each sixtieth of a second, for a game that draws with the same GPU. Work is sent
    /// in pieces of a view or of a few iterations, one after another, with pauses between them. `None`, as at first, is no
    /// limit, and the least limit is a tenth of a millisecond. The result is the same.
    pub fn limit_work(&self, in_a_frame: Option<Duration>) {
        self.0.pace.set_limit(in_a_frame);
    }

    /// Number of submissions so far; for tests of faults.
    #[doc(hidden)]
    pub fn submissions(&self) -> u32 {
        self.0.submissions()
    }

    /// Loses the device after so many submissions; for tests of faults.
    #[doc(hidden)]
    pub fn lose_after(&self, submissions: u32) {
        self.0.lose_after(submissions);
    }
}

impl Backend for Gpu {
    type Error = DeviceError;

    fn name(&self) -> &str {
        &self.0.name
    }

    fn can_hold(&self, view: usize, texture: usize) -> bool {
        let largest = (VECTOR * view * view).max(SUMS * texture * texture);
        largest as u64 <= self.0.device.limits().max_storage_buffer_binding_size
    }

    fn open<'a>(
        &'a self,
        low: &LowPoly,
        views: CoveredViews<'a>,
        cancellation: &'a Cancellation,
    ) -> Result<Box<dyn LevelRenderer<Error = DeviceError> + 'a>, DeviceError> {
        self.0.check()?;
        Ok(Box::new(Renderer::new(&self.0, low, views, cancellation)?))
    }
}
