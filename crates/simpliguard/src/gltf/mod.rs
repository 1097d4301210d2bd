//! glTF in and out.

mod export;
mod import;
mod uris;

pub(crate) use export::export_in;
pub use export::{ExportOptions, export, export_level};
pub(crate) use import::import_in;
pub use import::{Limits, has_levels, import};
pub use uris::external_uris;
