//! Parameters of the export.

/// The version that is written outside of the pipeline: that of this crate.
pub(super) const CRATE_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Parameters of the export.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub struct ExportParams {
    /// Keeps the source's meshes, materials and textures. Otherwise only its nodes, skins and clips stay.
    pub keep_source: bool,
}

impl Default for ExportParams {
    fn default() -> Self {
        Self { keep_source: true }
    }
}
