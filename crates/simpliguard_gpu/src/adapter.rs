//! Which of the machine's GPUs to use.

use std::path::Path;

use wgpu::{Adapter, AdapterInfo, Backends, DeviceType, Instance, InstanceDescriptor};

use crate::error::GpuError;

/// Environment variable that permits a GPU that is simulated in software, if it is `1`.
pub const SOFTWARE_ENV_VAR: &str = "SIMPLIGUARD_ALLOW_SOFTWARE_GPU";

/// The kinds of GPUs that may be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// Real ones. One that is simulated on the CPU is slower than the CPU itself.
    Real,
    /// Simulated ones too, for tests.
    AlsoSoftware,
}

impl Choice {
    /// Real ones, unless [`SOFTWARE_ENV_VAR`] says otherwise.
    pub fn from_env() -> Self {
        match std::env::var_os(SOFTWARE_ENV_VAR) {
            Some(value) if value == "1" => Self::AlsoSoftware,
            _ => Self::Real,
        }
    }
}

/// Files of the drivers of real GPUs: those of the kernel, of NVIDIA, and of Windows below Linux.
const DRIVERS: [&str; 3] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg"];

/// True if the machine may have a real GPU. Servers without one are spared to load drivers, which may print.
fn may_have_gpu() -> bool {
    !cfg!(target_os = "linux") || DRIVERS.iter().any(|file| Path::new(file).exists())
}

/// The best adapter: discrete before integrated ones, the first of each kind.
pub(crate) fn find(choice: Choice) -> Result<Adapter, GpuError> {
    if choice == Choice::Real && !may_have_gpu() {
        return Err(GpuError::NoAdapter(""));
    }
    let backends = Backends::VULKAN | Backends::METAL | Backends::DX12;
    let instance = Instance::new(InstanceDescriptor { backends, ..InstanceDescriptor::new_without_display_handle() });
    let adapters = futures_lite::future::block_on(instance.enumerate_adapters(backends));
    let found_software = adapters.iter().any(|adapter| !is_real(&adapter.get_info()));
    let allowed = |adapter: &Adapter| choice == Choice::AlsoSoftware || is_real(&adapter.get_info());
    let best = adapters.into_iter().filter(allowed).min_by_key(|adapter| rank(adapter.get_info().device_type));
    let hint = if found_software { ", only one that is simulated in software" } else { "" };
    best.ok_or(GpuError::NoAdapter(hint))
}

fn is_real(info: &AdapterInfo) -> bool {
    info.device_type != DeviceType::Cpu
}

fn rank(kind: DeviceType) -> u8 {
    match kind {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    }
}

/// The name of an adapter, with the way to it.
pub(crate) fn name(info: &AdapterInfo) -> String {
    format!("{}, {}", info.name, info.backend)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn real_adapters_come_first() {
        let mut kinds = [DeviceType::Cpu, DeviceType::Other, DeviceType::IntegratedGpu, DeviceType::DiscreteGpu];
        kinds.sort_by_key(|kind| rank(*kind));
        assert_eq!(kinds[0], DeviceType::DiscreteGpu);
        assert_eq!(kinds[3], DeviceType::Cpu);
    }
}
