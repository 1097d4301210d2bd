//! Messages about bakes for the game.

use std::time::Duration;

use bevy::asset::AssetPath;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use simpliguard::{Key, Report, StageId};

use super::status::{BakeStatus, Bakes};

/// The bake of a model begins: the cache has no result.
#[derive(Message, Clone, Debug)]
pub struct BakeStarted {
    /// The model.
    pub path: AssetPath<'static>,
}

/// A bake makes progress.
#[derive(Message, Clone, Debug)]
pub struct BakeProgress {
    /// The model.
    pub path: AssetPath<'static>,
    /// The stage at work.
    pub stage: StageId,
    /// Fraction of the whole bake that is done, 0 to 1.
    pub fraction: f32,
}

/// A bake has ended, and its result is in the place of the model. Bevy reloads the model on its own.
#[derive(Message, Clone, Debug)]
pub struct BakeFinished {
    /// The model.
    pub path: AssetPath<'static>,
    /// The report of the bake.
    pub report: Report,
    /// Time since the start of the bake. Zero if another process has baked the model meanwhile, or if Bevy has processed it
    /// once more.
    pub duration: Duration,
}

/// A bake has failed. The model has no levels, or keeps its last ones.
#[derive(Message, Clone, Debug)]
pub struct BakeFailed {
    /// The model.
    pub path: AssetPath<'static>,
    /// The error, and advice for the user.
    pub error: String,
}

/// An event that the bakes send to the game.
#[derive(Debug)]
pub(super) enum Event {
    /// The levels of a key are desired for a model. The cache has them, or they have to be baked.
    Desired {
        path: AssetPath<'static>,
        key: Key,
        is_cached: bool,
    },
    Started(Key, BakeStarted),
    Progress(Key, BakeProgress),
    Finished(Key, BakeFinished),
    /// Without a key if the settings of the model are wrong.
    Failed(Option<Key>, BakeFailed),
    /// The processed file of a model was swapped.
    Swapped(AssetPath<'static>),
}

/// The game's end of the channel.
#[derive(Resource)]
pub(super) struct EventReceiver(pub(super) async_channel::Receiver<Event>);

/// Writers of all messages about bakes.
#[derive(SystemParam)]
pub(super) struct BakeMessages<'w> {
    started: MessageWriter<'w, BakeStarted>,
    progress: MessageWriter<'w, BakeProgress>,
    finished: MessageWriter<'w, BakeFinished>,
    failed: MessageWriter<'w, BakeFailed>,
}

/// Turns the events since the last frame into messages and statuses.
pub(super) fn deliver(
    receiver: Res<EventReceiver>,
    server: Res<AssetServer>,
    mut bakes: ResMut<Bakes>,
    mut messages: BakeMessages,
) {
    while let Ok(event) = receiver.0.try_recv() {
        match event {
            Event::Desired { path, key, is_cached } => {
                let done = BakeStatus::cached();
                bakes.set_desired(&path, Some(key), if is_cached { done } else { BakeStatus::Queued });
            }
            Event::Started(key, message) => {
                bakes.advance(&message.path, key, BakeStatus::Baking { stage: StageId::Import, fraction: 0.0 });
                messages.started.write(message);
            }
            Event::Progress(key, message) => {
                let BakeProgress { stage, fraction, .. } = message;
                bakes.advance(&message.path, key, BakeStatus::Baking { stage, fraction });
                messages.progress.write(message);
            }
            Event::Finished(key, message) => {
                let warnings = message.report.all_levels().filter_map(|level| level.warning.clone()).collect();
                let hint = message.report.scene_hint().map(str::to_owned);
                bakes.advance(&message.path, key, BakeStatus::Done { duration: message.duration, warnings, hint });
                messages.finished.write(message);
            }
            Event::Failed(key, message) => {
                let status = BakeStatus::Failed { error: message.error.clone() };
                match key {
                    Some(key) => bakes.advance(&message.path, key, status),
                    None => bakes.set_desired(&message.path, None, status),
                }
                messages.failed.write(message);
            }
            // A watcher sees the change on its own.
            Event::Swapped(path) if !server.watching_for_changes() => server.reload(path),
            Event::Swapped(_) => {}
        }
    }
}
