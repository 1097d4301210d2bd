//! Bake settings: one table of fields, two types.
//!
//! [`BakeSettings`] are the settings of a bake: every field is present and in range. [`BakeOverrides`] has the same
//! fields as options. Users write overrides in `.meta` files, in `config/simpliguard.ron` and on the command line.
//! [`resolve`] lays overrides over each other and remembers the origin of each value.
//!
//! The module parses strings and never opens a file. So the plugin and the command read the same texts in the same way
//! and derive the same keys.
//!
//! Limits: comments and formatting of a RON file are not kept. A later layer cannot unset a field; it can set the
//! default.

mod atlas_size;
mod budgets;
mod choices;
mod field;
mod fields;
mod importance;
mod meta;
mod object_rules;
mod overrides;
mod patterns;
mod project;
mod resolve;
mod target;
mod text;
mod texture_size;
mod value;

pub use crate::data::{MaterialWeight, NodePattern, TextureFormat};
pub use atlas_size::AtlasSize;
pub use budgets::Budgets;
pub use choices::{
    Candidates, ExistingLods, InitialTexture, JointSplitting, LaplacianOf, LevelMaterials, MorphTargets, OnMiss,
    Quality, Resolution, Scope, SkinTransfer, SourceGeometry, TextureCompression, TextureSolver,
};
pub use field::FieldInfo;
pub use fields::{BakeOverrides, BakeSettings, ObjectRule, reference};
pub use meta::parse_meta;
pub(crate) use object_rules::{MatchingRules, RuleMatcher};
pub use overrides::parse_overrides;
pub use project::{
    BackendChoice, BakeMode, BakePriority, CacheSettings, ProjectFile, ProjectSettings, Rule, parse_cache_size,
};
pub use resolve::{Effective, Layer, Origin, Resolved, resolve};
pub use target::Target;
pub use texture_size::TextureSize;
