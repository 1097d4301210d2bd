//! The cache as the store of the pipeline's stages.

use bytes::Bytes;
use simpliguard::{Key, StageStore};
use simpliguard_cache::Cache;

/// Keeps the objects of stages in a cache. A storage error is a miss: the stage runs.
#[derive(Clone, Copy, Debug)]
pub struct StageObjects<'a>(pub &'a Cache);

impl StageStore for StageObjects<'_> {
    fn get(&self, key: &Key) -> Option<Bytes> {
        self.0.get_stage_object(key)
    }

    fn put(&self, key: &Key, bytes: &[u8]) {
        self.0.put_stage_object(key, bytes);
    }
}
