/// The reason why a GPU is not used, or not any more.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is none.
    #[error("no GPU with a driver for Vulkan, Metal or DirectX 12 was found{0}")]
    NoAdapter(&'static str),
    /// There is one that cannot run the kernels.
    #[error("the GPU '{name}' cannot be used: {found}; update its driver, or choose `backend: Cpu`")]
    Unsuitable {
        /// Its name.
        name: String,
        /// What it lacks.
        found: String,
    },
    /// A buffer is larger than WebGPU allows.
    #[error("{what} needs {bytes} bytes in one buffer, and the limit is {limit}; lower `view_size` or `texture_size`")]
    TooLarge {
        /// The buffer.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The largest size.
        limit: u64,
    },
    /// The device was lost, has no memory, or refused a command.
    #[error("{0}")]
    Failed(String),
    /// The device does not answer.
    #[error("it has given no result for {0} s")]
    TimedOut(u64),
}
