//! What is known of the bakes of all models.

use std::collections::BTreeMap;
use std::time::Duration;

use bevy::asset::AssetPath;
use bevy::prelude::*;
use simpliguard::StageId;

use super::events::{BakeFailed, BakeFinished, BakeProgress, BakeStarted};

/// How far the levels of a model are.
#[derive(Clone, Debug, PartialEq)]
pub enum BakeStatus {
    /// The bake waits for a free thread.
    Queued,
    /// The bake runs.
    Baking {
        /// The stage at work.
        stage: StageId,
        /// Part of the whole bake that is done, 0 to 1.
        fraction: f32,
    },
    /// The model is as its files and settings want it: with levels, or without if it needs none.
    Done {
        /// Time the bake took; zero if the cache had the result.
        duration: Duration,
    },
    /// The model has no levels, or keeps those of before.
    Failed {
        /// What was found and what to do about it.
        error: String,
    },
}

impl BakeStatus {
    /// Whether nothing more will happen unless a file changes.
    pub fn is_settled(&self) -> bool {
        matches!(self, Self::Done { .. } | Self::Failed { .. })
    }
}

/// The status of every model that was processed since the game started.
#[derive(Resource, Debug, Default)]
pub struct Bakes {
    models: BTreeMap<String, (AssetPath<'static>, BakeStatus)>,
}

impl Bakes {
    /// All models in the order of their paths.
    pub fn iter(&self) -> impl Iterator<Item = (&AssetPath<'static>, &BakeStatus)> {
        self.models.values().map(|(path, status)| (path, status))
    }

    /// Whether no bake runs or waits.
    pub fn is_settled(&self) -> bool {
        self.models.values().all(|(_, status)| status.is_settled())
    }

    fn set(&mut self, path: &AssetPath<'static>, status: BakeStatus) {
        self.models.insert(path.to_string(), (path.clone(), status));
    }
}

pub(super) fn follow(
    mut bakes: ResMut<Bakes>,
    mut started: MessageReader<BakeStarted>,
    mut progress: MessageReader<BakeProgress>,
    mut finished: MessageReader<BakeFinished>,
    mut failed: MessageReader<BakeFailed>,
) {
    for bake in started.read() {
        bakes.set(&bake.path, BakeStatus::Baking { stage: StageId::Import, fraction: 0.0 });
    }
    for bake in progress.read() {
        bakes.set(&bake.path, BakeStatus::Baking { stage: bake.stage, fraction: bake.fraction });
    }
    for bake in finished.read() {
        bakes.set(&bake.path, BakeStatus::Done { duration: bake.duration });
    }
    for bake in failed.read() {
        bakes.set(&bake.path, BakeStatus::Failed { error: bake.error.clone() });
    }
}
