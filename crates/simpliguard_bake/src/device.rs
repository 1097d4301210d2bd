//! The processor that refines levels. A GPU is opened once in a program, when the first bake needs it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use simpliguard::refine::Device;
use simpliguard::settings::BackendChoice;

use crate::host::Notice;

/// The processor that refines levels, and how much of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Processor {
    /// Which one.
    pub backend: BackendChoice,
    /// Most work of a GPU in each frame of the game that draws with it; `None` if there is no limit.
    pub work_in_a_frame: Option<Duration>,
}

impl From<BackendChoice> for Processor {
    /// All of it.
    fn from(backend: BackendChoice) -> Self {
        Self { backend, work_in_a_frame: None }
    }
}

/// The device for a bake; `None` for the CPU. The reason why a GPU that was asked for is not used is told once.
pub fn find_device(processor: Processor, notify: impl FnOnce(Notice)) -> Option<&'static Device> {
    static IS_TOLD: AtomicBool = AtomicBool::new(false);
    let found = match processor.backend {
        BackendChoice::Cpu => Ok(None),
        BackendChoice::Auto | BackendChoice::Gpu => open(processor),
    };
    found.unwrap_or_else(|reason| {
        if !IS_TOLD.swap(true, Ordering::Relaxed) {
            notify(Notice::NoDevice(reason));
        }
        None
    })
}

#[cfg(feature = "gpu")]
fn open(Processor { backend, work_in_a_frame }: Processor) -> Result<Option<&'static Device>, String> {
    use std::sync::OnceLock;

    use simpliguard_gpu::{Choice, Gpu, GpuError};

    static GPU: OnceLock<Result<Gpu, GpuError>> = OnceLock::new();
    match GPU.get_or_init(|| Gpu::open(Choice::from_env())) {
        // The bake in which it was lost has told so.
        Ok(gpu) if gpu.is_lost() => Ok(None),
        Ok(gpu) => {
            gpu.limit_work(work_in_a_frame);
            Ok(Some(gpu))
        }
        Err(GpuError::NoAdapter(_)) if backend == BackendChoice::Auto => Ok(None),
        Err(error) => Err(error.to_string()),
    }
}

#[cfg(not(feature = "gpu"))]
fn open(processor: Processor) -> Result<Option<&'static Device>, String> {
    match processor.backend {
        BackendChoice::Gpu => Err("this program is built without the feature `gpu`".to_owned()),
        BackendChoice::Auto | BackendChoice::Cpu => Ok(None),
    }
}
