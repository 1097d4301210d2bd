//! Extreme mesh simplification for games.
//!
//! A glTF file goes in. One glTF with levels of detail of at most 1,000, 2,000 and 4,000 triangles (by default) comes out,
//! each with one material, one texture set and the source's own skeleton. The stages follow *SimpliGuard: Robust Mesh
//! Simplification In the Wild*. [`bake`] runs them all; [`STAGES`] is their table:
//!
//! ```text
//! glb -> import -> views -> reconstruct, simplify -> unwrap -> skinning -> texture -> refine -> maps -> export -> glb
//! ```
//!
//! The crate is pure: it touches neither the file system nor the network. External files of a glTF are read through
//! [`Resources`], results are returned as bytes.
//!
//! The folders, from the top to the bottom; imports run down only:
//!
//! - `pipeline`: the way through. `mod.rs` has one line for each stage, `runner.rs` runs them, `params.rs` turns settings
//!   into the parameters of the stages, `store/` keeps results of stages for later bakes.
//! - [`settings`]: the fields that users set, and the layers they come from.
//! - [`gltf`], [`reconstruct`], [`simplify`], [`skinning`], [`unwrap`], [`texture`], [`refine`]: the stages.
//! - [`render`]: cameras, rasteriser and shading, for every stage that needs an image.
//! - [`animation`]: skeleton, poses and linear blend skinning.
//! - [`geometry`]: trees, intersections, connected components, sampling, random numbers.
//! - [`data`]: plain data without algorithms.

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
pub use error::{Error, Printable, StageId};
pub use pipeline::context::{Context, PreviewSink, Progress, ProgressSink, StageStore};
pub use pipeline::params::Params;
pub use pipeline::report::{LevelReport, LevelTopology, ObjectReport, OwnLevelReport, Report, StageSeconds, Status};
pub use pipeline::scene::{ObjectProgress, ObjectSource, SceneBake};
pub use pipeline::stage::{STAGES, Stage};
pub use pipeline::store::{bake_key, is_stage_object};
pub use pipeline::{
    Baked, Bars, Likeness, Miss, OPT_LEVEL, PIPELINE_VERSION, StageObject, WrongMaterial, bake, stage_objects,
};
pub use simpliguard_key::{Key, KeyBuilder, content_hash};
pub use source::{NoResources, RelativeUri, Resources, Source};
