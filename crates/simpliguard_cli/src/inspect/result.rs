//! The result of a bake in the cache of this machine.

use serde::Serialize;
use simpliguard_bake::{CachedBake, Parts, look_up};

use crate::console;

/// The result of a bake with these settings.
#[derive(Serialize)]
pub(super) struct CachedResult {
    /// It stands for all bytes of the source, the settings and the version of the pipeline.
    pub(super) key: String,
    pub(super) cached: bool,
    /// Of a result in the cache.
    pub(super) levels: Vec<CachedLevel>,
}

#[derive(Serialize)]
pub(super) struct CachedLevel {
    pub(super) level: u32,
    pub(super) budget: u32,
    pub(super) faces: u32,
    pub(super) error: f32,
    pub(super) psnr: Option<f32>,
}

impl CachedResult {
    /// Looks a result up in the cache of this machine.
    pub(super) fn find(bake: &CachedBake<'_>, cache: Option<&simpliguard_cache::Cache>) -> Self {
        let warn = |notice: simpliguard_bake::Notice| console::warning(&notice.to_string());
        let found = cache.and_then(|cache| look_up(cache, &bake.key(), Parts::Combined, warn));
        let level = |report: &simpliguard::LevelReport| CachedLevel {
            level: report.level,
            budget: report.budget,
            faces: report.faces,
            error: report.error,
            psnr: report.likeness.as_ref().map(|likeness| likeness.psnr),
        };
        let levels = found.iter().flat_map(|result| &result.report.levels).map(level).collect();
        Self { key: bake.key().to_string(), cached: found.is_some(), levels }
    }
}
