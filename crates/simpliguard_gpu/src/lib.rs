//! Refines levels of detail on a GPU, through wgpu: Vulkan, Metal and DirectX 12.
//!
//! [`Gpu`] is a [`Backend`](simpliguard::refine::Backend) of the refine stage. What costs time there are pixels, and they are
//! made and used on the device: visibility, shading, antialiasing, the image loss, the gradients at the vertices, the squared
//! errors of the score, and the least-squares texture. The views of the source, the triangles and the texture stay there for
//! all steps of a level. Positions of vertices go there, and their gradients come back.
//!
//! The kernels are WGSL and stay within the limits of WebGPU. A device gives equal bytes for equal inputs: sums over pixels
//! are gathered in a fixed order or made of integers. Another device, or the CPU, differs by rounding.
//!
//! A device that is lost, has no memory or takes too long is an error of the level, which is then refined on the CPU.

mod adapter;
mod device;
mod error;
mod frame;
mod gpu;
mod kernels;
mod level_buffers;
mod pace;
mod renderer;
mod self_test;
mod solve_texture;
mod source_views;
mod texture_least_squares;

pub use adapter::{Choice, SOFTWARE_ENV_VAR};
pub use error::GpuError;
pub use gpu::Gpu;
