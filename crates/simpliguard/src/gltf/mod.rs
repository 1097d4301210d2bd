//! glTF in and out.

mod export;

pub use export::{ExportOptions, SourceGeometry, export, export_level};
