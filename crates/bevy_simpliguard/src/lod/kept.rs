//! What a game has set on the objects of a scene, kept while the scene is reloaded.
//!
//! A reload spawns all nodes anew. An object is known again by its path in the scene, so objects that were added, moved or
//! removed beside it make no difference.

use bevy::platform::collections::HashMap;
use bevy::prelude::*;

use super::components::{LodGroup, SimpliguardLods};

/// The settings of the objects of an instance that differ from those of a fresh one, by [`LodGroup::object`]. It is on the entity
/// with the scene.
#[derive(Component, Default)]
pub(super) struct KeptObjects(HashMap<String, Kept>);

/// What a game sets on an object.
#[derive(Clone, Debug, PartialEq)]
struct Kept {
    force: Option<u32>,
    bias: f32,
    enabled: bool,
    visibility: Visibility,
}

impl Kept {
    fn of(lods: &SimpliguardLods, visibility: Visibility) -> Self {
        Self { force: lods.force, bias: lods.bias, enabled: lods.enabled, visibility }
    }
}

impl KeptObjects {
    /// Keeps what is set on an object that is about to go.
    pub(super) fn keep(&mut self, group: &LodGroup, lods: &SimpliguardLods, visibility: Visibility) {
        let kept = Kept::of(lods, visibility);
        if kept == Kept::of(&SimpliguardLods::default(), Visibility::default()) {
            self.0.remove(&group.object);
        } else {
            self.0.insert(group.object.clone(), kept);
        }
    }

    /// Sets the same on the entity of an object that has come again.
    pub(super) fn restore(&mut self, group: &LodGroup, object: &mut EntityCommands<'_>) {
        let Some(Kept { force, bias, enabled, visibility }) = self.0.remove(&group.object) else { return };
        object.insert((SimpliguardLods { force, bias, enabled, ..default() }, visibility));
    }
}
