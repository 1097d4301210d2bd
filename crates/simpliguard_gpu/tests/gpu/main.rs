//! The kernels against the CPU, and bakes whose device fails. Without a GPU, real or simulated, each test prints a line and
//! passes.

mod bakes;
mod kernels;
mod scene;

use std::sync::LazyLock;

use simpliguard_gpu::{Choice, Gpu, GpuError};

static GPU: LazyLock<Result<Gpu, GpuError>> = LazyLock::new(|| Gpu::open(Choice::AlsoSoftware));

/// The GPU that the tests share.
fn gpu() -> Option<&'static Gpu> {
    found(GPU.as_ref().map_err(Clone::clone))
}

/// Only a machine without any GPU may skip a test.
fn found<T>(opened: Result<T, GpuError>) -> Option<T> {
    match opened {
        Err(error @ GpuError::NoAdapter(_)) => {
            #[expect(clippy::print_stderr, reason = "the only trace of a test that did not run")]
            {
                eprintln!("skipped: {error}");
            }
            None
        }
        opened => Some(opened.expect("a GPU that works")),
    }
}
