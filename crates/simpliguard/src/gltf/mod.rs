//! glTF in and out.

mod export;
mod import;

pub use export::{ExportOptions, SourceGeometry, export, export_level};
pub use import::{Limits, has_levels, import};
