//! A GPU with its kernels, and the watch over its failures.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Duration;

use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, Device, DeviceDescriptor, Limits, MapMode, PollError,
    PollType, Queue,
};

use crate::adapter::{self, Choice};
use crate::error::GpuError;
use crate::kernels::Kernels;
use crate::pace::Pace;

/// Longest wait for a result. It is the work of all views at most, each of which is submitted alone and takes milliseconds.
const TIMEOUT: Duration = Duration::from_secs(120);

/// A GPU. All levels and threads of a program share it.
pub(crate) struct GpuDevice {
    /// Its name, with the way to it.
    pub(crate) name: String,
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    pub(crate) kernels: Kernels,
    /// Which of its two passes `find_blends` makes.
    pub(crate) passes_of_find: [Buffer; 2],
    /// How long it may work in a frame of a game.
    pub(crate) pace: Pace,
    /// The first failure, or the loss. Nothing can be done after it.
    failure: Arc<Mutex<Option<String>>>,
    /// Submissions before the device is destroyed, in tests of faults.
    fuse: AtomicU32,
}

fn locked(failure: &Mutex<Option<String>>) -> MutexGuard<'_, Option<String>> {
    failure.lock().unwrap_or_else(PoisonError::into_inner)
}

impl GpuDevice {
    /// Opens the best GPU of the machine.
    ///
    /// # Errors
    /// If there is none, or if it cannot be used.
    pub(crate) fn open(choice: Choice) -> Result<Self, GpuError> {
        let adapter = adapter::find(choice)?;
        let name = adapter::name(&adapter.get_info());
        let unsuitable = |found: String| GpuError::Unsuitable { name: name.clone(), found };
        // Those of WebGPU, with as large buffers as there can be.
        let Limits { max_storage_buffer_binding_size, max_buffer_size, .. } = adapter.limits();
        let required_limits = Limits { max_storage_buffer_binding_size, max_buffer_size, ..Limits::default() };
        let descriptor =
            DeviceDescriptor { label: Some("simpliguard"), required_limits, ..DeviceDescriptor::default() };
        let opened = futures_lite::future::block_on(adapter.request_device(&descriptor));
        let (device, queue) = opened.map_err(|e| unsuitable(e.to_string()))?;
        let failure = Arc::new(Mutex::new(None));
        watch(&device, &failure);
        let kernels = Kernels::new(&device);
        let passes_of_find = [0, 1].map(|pass| uniform(&device, &queue, &[pass, 0, 0, 0]));
        if let Some(found) = locked(&failure).clone() {
            return Err(unsuitable(found));
        }
        let fuse = AtomicU32::new(u32::MAX);
        Ok(Self { name, device, queue, kernels, passes_of_find, pace: Pace::default(), failure, fuse })
    }

    /// A buffer of zeros, which kernels read and write.
    pub(crate) fn buffer(&self, what: &'static str, bytes: usize) -> Result<Buffer, GpuError> {
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        self.buffer_for(what, bytes, usage)
    }

    pub(crate) fn buffer_for(&self, what: &'static str, bytes: usize, usage: BufferUsages) -> Result<Buffer, GpuError> {
        let (bytes, limit) = ((bytes as u64).max(16), self.device.limits().max_storage_buffer_binding_size);
        if bytes > limit {
            return Err(GpuError::TooLarge { what, bytes, limit });
        }
        let descriptor = BufferDescriptor { label: Some(what), size: bytes, usage, mapped_at_creation: false };
        let buffer = self.device.create_buffer(&descriptor);
        // Error scopes would tell which buffer it was, but they are not those of one thread in all builds of wgpu.
        self.check()?;
        Ok(buffer)
    }

    /// A buffer with this content.
    pub(crate) fn buffer_of<T: bytemuck::NoUninit>(
        &self,
        what: &'static str,
        content: &[T],
    ) -> Result<Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(content);
        let buffer = self.buffer(what, bytes.len())?;
        self.queue.write_buffer(&buffer, 0, bytes);
        Ok(buffer)
    }

    /// Sends commands to the device, at the pace that it may work at.
    pub(crate) fn submit(&self, encoder: CommandEncoder) -> Result<wgpu::SubmissionIndex, GpuError> {
        self.pace.run(|| self.submit_now(encoder), |submission| self.wait(submission))
    }

    fn submit_now(&self, encoder: CommandEncoder) -> Result<wgpu::SubmissionIndex, GpuError> {
        if self.fuse.fetch_sub(1, Ordering::Relaxed) == 0 {
            self.device.destroy();
        }
        self.check()?;
        let submission = self.queue.submit([encoder.finish()]);
        // Frees what is done with, and tells of a device that was lost.
        let _ = self.device.poll(PollType::Poll);
        self.check()?;
        Ok(submission)
    }

    /// Sends commands, waits until the device is done, and returns the content of `staging`.
    pub(crate) fn read(&self, encoder: CommandEncoder, staging: &Buffer) -> Result<Vec<u8>, GpuError> {
        let submission = self.submit(encoder)?;
        let (sender, receiver) = mpsc::channel();
        let slice = staging.slice(..);
        slice.map_async(MapMode::Read, move |mapped| drop(sender.send(mapped)));
        self.wait(&submission)?;
        // Another thread that polls the device may be the one that calls back.
        match receiver.recv_timeout(TIMEOUT) {
            Ok(Ok(())) => {}
            _ => return Err(GpuError::Failed("the device does not hand out its result".to_owned())),
        }
        let bytes = slice.get_mapped_range().to_vec();
        staging.unmap();
        Ok(bytes)
    }

    /// Waits until the device is done with what was sent to it.
    fn wait(&self, submission: &wgpu::SubmissionIndex) -> Result<(), GpuError> {
        let wait = PollType::Wait { submission_index: Some(submission.clone()), timeout: Some(TIMEOUT) };
        match self.device.poll(wait) {
            Ok(_) => self.check(),
            Err(PollError::Timeout) => {
                let _ = self.device.poll(PollType::Poll);
                self.check()?;
                Err(GpuError::TimedOut(TIMEOUT.as_secs()))
            }
            Err(error) => {
                // A lost device took nothing. It tells of its loss once the work before that is done.
                let _ = self.device.poll(PollType::Wait { submission_index: None, timeout: Some(TIMEOUT) });
                self.check()?;
                Err(GpuError::Failed(error.to_string()))
            }
        }
    }

    /// `Err` once the device has failed.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        match &*locked(&self.failure) {
            Some(failure) => Err(GpuError::Failed(failure.clone())),
            None => Ok(()),
        }
    }

    /// Number of submissions so far, unless the device is to be lost.
    pub(crate) fn submissions(&self) -> u32 {
        u32::MAX - self.fuse.load(Ordering::Relaxed)
    }

    /// Loses the device after so many submissions.
    pub(crate) fn lose_after(&self, submissions: u32) {
        self.fuse.store(submissions, Ordering::Relaxed);
    }
}

/// Keeps the first failure of a device, or its loss. Without this, wgpu would panic.
fn watch(device: &Device, failure: &Arc<Mutex<Option<String>>>) {
    let (lost, refused) = (failure.clone(), failure.clone());
    device.set_device_lost_callback(move |_, message| {
        *locked(&lost) = Some(format!("the device was lost: {message}"));
    });
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        let text = match error {
            wgpu::Error::OutOfMemory { .. } => "the device has no memory left".to_owned(),
            // On one line, for a note.
            error => {
                let text = error.to_string();
                format!("the device failed: {}", text.split_whitespace().collect::<Vec<_>>().join(" "))
            }
        };
        locked(&refused).get_or_insert(text);
    }));
}

fn uniform(device: &Device, queue: &Queue, content: &[u32]) -> Buffer {
    let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
    let size = size_of_val(content) as u64;
    let buffer = device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    queue.write_buffer(&buffer, 0, bytemuck::cast_slice(content));
    buffer
}
