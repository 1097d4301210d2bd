//! The memory of the machine.

use simpliguard::gltf::ImportLimits;
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

/// The memory that a bake may take if nobody says otherwise, in bytes: half of the machine's, or of what the container
/// around this process may have.
pub fn default_memory() -> u64 {
    let memory = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    let smallest = |system: System| {
        let container = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
        system.total_memory().min(container)
    };
    match System::new_with_specifics(memory).map_or(0, smallest) {
        // A system that does not tell.
        0 => ImportLimits::default().memory,
        bytes => bytes / 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_has_memory() {
        assert!((16 << 20..1 << 50).contains(&default_memory()), "{}", default_memory());
    }
}
