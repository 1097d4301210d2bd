//! Extreme mesh simplification for games.
//!
//! A glTF file goes in; one glTF with levels of detail of at most 1,000, 2,000 and 4,000 triangles (by default) comes
//! out, each with one material, one texture set and the source's own skeleton. The stages follow *SimpliGuard: Robust
//! Mesh Simplification In the Wild*:
//!
//! ```text
//! glb -> import -> reconstruct -> shape -> rig -> unwrap -> texture -> refine -> export -> glb
//! ```
//!
//! The crate is pure: it touches neither the file system nor the network. External files of a glTF are read through
//! [`Resources`], results are returned as bytes. [`bake`] is the whole chain.

pub mod animation;
mod cancellation;
pub mod data;
mod error;
pub mod geometry;
pub mod gltf;
mod pipeline;
pub mod reconstruct;
pub mod refine;
pub mod render;
pub mod settings;
pub mod simplify;
pub mod skinning;
mod source;
pub mod texture;
pub mod unwrap;

pub use cancellation::Cancellation;
pub use error::{Error, StageId};
pub use pipeline::context::{Context, PreviewSink, Progress, ProgressSink, StageStore};
pub use pipeline::params::Params;
pub use pipeline::report::{LevelReport, LevelTopology, Report, StageSeconds, Status};
pub use pipeline::stage::{STAGES, Stage};
pub use pipeline::store::bake_key;
pub use pipeline::{Baked, OPT_LEVEL, PIPELINE_VERSION, bake};
pub use simpliguard_key::{Key, KeyBuilder, content_hash};
pub use source::{NoResources, RelativeUri, Resources, Source};
