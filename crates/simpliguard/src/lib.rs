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

mod bvh;
mod chain;
mod clock;
mod context;
mod error;
pub mod gltf;
mod key;
mod level;
pub mod mesh;
pub mod model;
mod objects;
mod pictures;
pub mod reconstruct;
pub mod refine;
pub mod render;
pub mod rig;
pub mod settings;
pub mod shape;
mod source;
mod targets;
pub mod texture;
pub mod unwrap;

pub use bvh::{Bvh, Hit, barycentric, closest_point};
pub use chain::{
    Baked, LevelReport, LevelTopology, OPT_LEVEL, PIPELINE_VERSION, Report, STAGES, Stage, StageSeconds, Status, bake,
};
pub use context::{Cancellation, Context, PreviewSink, Progress, ProgressSink, StageStore};
pub use error::{Error, StageId};
pub use key::{Key, KeyBuilder, content_hash};
pub use source::{NoResources, RelativeUri, Resources, Source};
