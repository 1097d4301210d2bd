//! The stages of a bake, and their results in the cache.

use serde::Serialize;
use simpliguard::settings::BakeSettings;
use simpliguard::{Key, STAGES, Source, StageId, StageObject, StageStore, stage_objects};
use simpliguard_bake::StageObjects;
use simpliguard_cache::Cache;

use super::result::CachedResult;
use crate::console;

/// A result of a stage. A stage that stores none has a row without a content.
#[derive(Serialize)]
pub(super) struct StageResult {
    pub(super) stage: StageId,
    /// Number of the level, from 1. Null for the whole model.
    pub(super) level: Option<usize>,
    /// Null if the stage stores nothing.
    pub(super) content: Option<String>,
    pub(super) key: Option<String>,
    /// The stage whose result the key depends on, if the key is not known without it.
    pub(super) needs: Option<StageId>,
    pub(super) cached: bool,
}

/// A store of nothing.
struct Nothing;

impl StageStore for Nothing {
    fn get(&self, _: &Key) -> Option<bytes::Bytes> {
        None
    }

    fn put(&self, _: &Key, _: &[u8]) {}
}

/// The results of the stages in their order. None for a file that gets no levels.
pub(super) fn results(
    source: &Source<'_>,
    settings: &BakeSettings,
    cache: Option<&Cache>,
    result: &CachedResult,
) -> Vec<StageResult> {
    let stages = cache.map(StageObjects);
    let stages = stages.as_ref().map_or(&Nothing as &dyn StageStore, |stages| stages);
    let found = stage_objects(source, settings, stages);
    let objects = found.inspect_err(|error| console::warning(&error.to_string())).unwrap_or_default();
    if objects.is_empty() {
        return Vec::new();
    }
    let of_stage = |stage: StageId| {
        let mut all: Vec<StageResult> =
            objects.iter().filter(|object| object.stage == stage).map(StageResult::of).collect();
        if stage == StageId::Export {
            all.push(StageResult::whole(result));
        }
        if all.is_empty() {
            all.push(StageResult::none(stage));
        }
        all
    };
    STAGES.iter().flat_map(|stage| of_stage(stage.id)).collect()
}

impl StageResult {
    fn none(stage: StageId) -> Self {
        Self { stage, level: None, content: None, key: None, needs: None, cached: false }
    }

    fn of(StageObject { stage, level, content, key, cached }: &StageObject) -> Self {
        let needs = key.err();
        let key = key.ok().map(|key| key.hex());
        Self { stage: *stage, level: *level, content: Some(content.clone()), key, needs, cached: *cached }
    }

    /// The file that the last stage writes.
    fn whole(result: &CachedResult) -> Self {
        let (content, key) = (Some("result".to_owned()), Some(result.key.clone()));
        Self { content, key, cached: result.cached, ..Self::none(StageId::Export) }
    }
}
