//! The status of the bakes of all models.

use std::collections::BTreeMap;
use std::time::Duration;

use bevy::asset::AssetPath;
use bevy::prelude::*;
use simpliguard::{Key, StageId};

/// The status of the levels of a model.
#[derive(Clone, Debug, PartialEq)]
pub enum BakeStatus {
    /// The bake waits for a free thread, or for a missing file that the model refers to.
    Queued,
    /// The bake runs.
    Baking {
        /// The stage at work.
        stage: StageId,
        /// Fraction of the whole bake that is done, 0 to 1.
        fraction: f32,
    },
    /// The model is in its final form: with levels, or without if it needs none.
    Done {
        /// Time the bake took; zero if the cache had the result.
        duration: Duration,
        /// What is wrong with levels that hardly look like their source, one line each. Empty if the cache had the result.
        warnings: Vec<String>,
        /// Advice for a file that looks like a scene of many objects. `None` if the cache had the result.
        hint: Option<String>,
    },
    /// The bake failed. The model has no levels, or keeps its last ones.
    Failed {
        /// The error, and advice for the user.
        error: String,
    },
}

impl BakeStatus {
    /// The cache had the levels.
    pub(super) fn cached() -> Self {
        Self::Done { duration: Duration::ZERO, warnings: Vec::new(), hint: None }
    }

    /// Tells whether the status stays as it is until a file changes.
    pub fn is_settled(&self) -> bool {
        matches!(self, Self::Done { .. } | Self::Failed { .. })
    }
}

/// The status of every model that was processed since the start of the game, updated in `PreUpdate`. Models that have
/// not changed since the last start are not processed again, and are not in here.
#[derive(Resource, Debug, Default)]
pub struct Bakes {
    models: BTreeMap<String, Bake>,
}

#[derive(Debug)]
struct Bake {
    path: AssetPath<'static>,
    /// The key of the desired levels. Events of other keys are outdated.
    key: Option<Key>,
    status: BakeStatus,
}

impl Bakes {
    /// The status of a model.
    pub fn get(&self, path: &AssetPath<'_>) -> Option<&BakeStatus> {
        self.models.get(&path.to_string()).map(|bake| &bake.status)
    }

    /// All models in the order of their paths.
    pub fn iter(&self) -> impl Iterator<Item = (&AssetPath<'static>, &BakeStatus)> {
        self.models.values().map(|bake| (&bake.path, &bake.status))
    }

    /// Tells whether no bake runs or waits.
    pub fn is_settled(&self) -> bool {
        self.models.values().all(|bake| bake.status.is_settled())
    }

    /// Sets the desired levels of a model. The key is `None` if the settings of the model are wrong.
    pub(super) fn set_desired(&mut self, path: &AssetPath<'static>, key: Option<Key>, status: BakeStatus) {
        self.models.insert(path.to_string(), Bake { path: path.clone(), key, status });
    }

    /// Sets the status of a bake, unless it is outdated.
    pub(super) fn advance(&mut self, path: &AssetPath<'static>, key: Key, status: BakeStatus) {
        if let Some(bake) = self.models.get_mut(&path.to_string()).filter(|bake| bake.key == Some(key)) {
            bake.status = status;
        }
    }
}

#[cfg(test)]
mod tests {
    use simpliguard::KeyBuilder;

    use super::*;

    #[test]
    fn an_outdated_bake_changes_nothing() {
        let path = AssetPath::from("a/b.glb");
        let [old, new] = ["1", "2"].map(|version| KeyBuilder::new(version).finish());
        let baking = |fraction| BakeStatus::Baking { stage: StageId::Simplify, fraction };
        let mut bakes = Bakes::default();
        bakes.advance(&path, old, baking(0.1));
        assert_eq!(bakes.get(&path), None);
        bakes.set_desired(&path, Some(old), BakeStatus::Queued);
        bakes.advance(&path, old, baking(0.2));
        assert_eq!(bakes.get(&path), Some(&baking(0.2)));
        assert!(!bakes.is_settled());
        bakes.set_desired(&path, Some(new), BakeStatus::cached());
        bakes.advance(&path, old, baking(0.3));
        assert!(bakes.is_settled());
        bakes.set_desired(&path, None, BakeStatus::Failed { error: "x".into() });
        bakes.advance(&path, new, baking(0.4));
        let all: Vec<_> = bakes.iter().map(|(path, status)| (path.to_string(), status.clone())).collect();
        assert_eq!(all, [("a/b.glb".to_owned(), BakeStatus::Failed { error: "x".into() })]);
    }
}
