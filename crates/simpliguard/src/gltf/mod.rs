//! glTF in and out.

mod export;
mod uris;

pub use export::{ExportOptions, export, export_level};
pub use uris::external_uris;
