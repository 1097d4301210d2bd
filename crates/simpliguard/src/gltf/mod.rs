//! glTF in and out.

mod export;
mod import;
mod uris;

pub use export::{ExportOptions, export, export_level};
pub use import::{Limits, has_levels, import};
pub use uris::external_uris;
