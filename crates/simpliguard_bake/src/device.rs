//! The device that refines levels. It is opened once in a program, when the first bake needs it.

use std::sync::atomic::{AtomicBool, Ordering};

use simpliguard::refine::Device;
use simpliguard::settings::BackendChoice;

use crate::host::Notice;

/// The device for a bake; `None` for the CPU. The reason why a GPU that was asked for is not used is told once.
pub fn find_device(choice: BackendChoice, notify: impl FnOnce(Notice)) -> Option<&'static Device> {
    static IS_TOLD: AtomicBool = AtomicBool::new(false);
    let found = match choice {
        BackendChoice::Cpu => Ok(None),
        BackendChoice::Auto | BackendChoice::Gpu => open(choice),
    };
    found.unwrap_or_else(|reason| {
        if !IS_TOLD.swap(true, Ordering::Relaxed) {
            notify(Notice::NoDevice(reason));
        }
        None
    })
}

#[cfg(feature = "gpu")]
fn open(choice: BackendChoice) -> Result<Option<&'static Device>, String> {
    use std::sync::OnceLock;

    use simpliguard_gpu::{Choice, Gpu, GpuError};

    static GPU: OnceLock<Result<Gpu, GpuError>> = OnceLock::new();
    match GPU.get_or_init(|| Gpu::open(Choice::from_env())) {
        // The bake in which it was lost has told so.
        Ok(gpu) if gpu.is_lost() => Ok(None),
        Ok(gpu) => Ok(Some(gpu)),
        Err(GpuError::NoAdapter(_)) if choice == BackendChoice::Auto => Ok(None),
        Err(error) => Err(error.to_string()),
    }
}

#[cfg(not(feature = "gpu"))]
fn open(choice: BackendChoice) -> Result<Option<&'static Device>, String> {
    match choice {
        BackendChoice::Gpu => Err("this program is built without the feature `gpu`".to_owned()),
        BackendChoice::Auto | BackendChoice::Cpu => Ok(None),
    }
}
