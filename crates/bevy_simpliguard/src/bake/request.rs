//! Requests for bakes.

use std::sync::Arc;

use bevy::asset::AssetPath;
use bevy::prelude::*;
use simpliguard::Key;
use simpliguard::settings::BakeSettings;
use simpliguard_bake::{BakeResult, Parts, look_up};
use simpliguard_cache::Cache;

/// A request for the levels of a model.
#[derive(Clone, Debug)]
pub(super) struct BakeRequest {
    pub(super) path: AssetPath<'static>,
    pub(super) settings: BakeSettings,
    /// The key of the result.
    pub(super) key: Key,
    /// The key of the same result with images for textures.
    pub(super) image_key: Key,
    /// The cache of results. `None` if there is no place for one.
    pub(super) cache: Option<Arc<Cache>>,
}

impl BakeRequest {
    /// The result, without single levels, if the cache has it.
    pub(super) fn cached(&self) -> Option<BakeResult> {
        self.find(&self.key)
    }

    /// The result with images for textures, if the cache has it.
    pub(super) fn cached_with_images(&self) -> Option<BakeResult> {
        self.find(&self.image_key)
    }

    fn find(&self, key: &Key) -> Option<BakeResult> {
        let warn = |notice| warn!("{}: {notice}", self.path);
        look_up(self.cache.as_deref()?, key, Parts::Combined, warn)
    }
}
