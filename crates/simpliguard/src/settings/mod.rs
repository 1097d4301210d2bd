//! Bake settings: one list of fields, two types.
//!
//! [`BakeSettings`] is what the stages read: every field is present and in range. [`BakeOverrides`] has the same fields
//! as options; it is what users write, in `.meta` files, in `config/simpliguard.ron` and on the command line.
//! [`resolve`] lays overrides over each other and remembers where each value came from.
//!
//! The module is pure: it parses strings and never opens a file, so that the plugin and the command read the same
//! texts in the same way and derive the same keys.
//!
//! Limits: comments and formatting of a RON file are not kept; there is no way to unset a field in a later layer other
//! than by writing its default.

mod fields;
mod importance;
mod meta;
mod project;
mod resolve;
mod target;
mod text;
mod value;

pub use crate::data::MaterialWeight;
pub use fields::{
    BakeOverrides, BakeSettings, Candidates, ExistingLods, FieldInfo, InitialTexture, JointPlanes, MorphTargets,
    Quality, SkinTransfer, SourceGeometry, TextureSolver, reference,
};
pub use meta::parse_meta;
pub use project::{BakeMode, BakePriority, CacheSettings, ProjectFile, ProjectSettings, Rule, parse_cache_size};
pub use resolve::{Effective, Layer, Origin, Resolved, resolve};
pub use target::Target;
pub use text::parse_overrides;
pub use value::{Resolution, TextureFormat};
