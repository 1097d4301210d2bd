//! What a game hears of the bakes of its models.

use std::time::Duration;

use bevy::asset::AssetPath;
use bevy::prelude::*;
use simpliguard::{Report, StageId};
use simpliguard_cache::Key;

use super::status::{BakeStatus, Bakes};

/// A model that is not in the cache is being baked.
#[derive(Message, Clone, Debug)]
pub struct BakeStarted {
    /// The model.
    pub path: AssetPath<'static>,
}

/// A bake has come further.
#[derive(Message, Clone, Debug)]
pub struct BakeProgress {
    /// The model.
    pub path: AssetPath<'static>,
    /// The stage at work.
    pub stage: StageId,
    /// Part of the whole bake that is done, 0 to 1.
    pub fraction: f32,
}

/// A bake is done and its result is in place of the model; Bevy loads it again by itself.
#[derive(Message, Clone, Debug)]
pub struct BakeFinished {
    /// The model.
    pub path: AssetPath<'static>,
    /// What was made.
    pub report: Report,
    /// From the start of the bake. Zero if another process had baked the model in the meantime.
    pub duration: Duration,
}

/// A model has no levels, or keeps those of before. The game goes on with what it has.
#[derive(Message, Clone, Debug)]
pub struct BakeFailed {
    /// The model.
    pub path: AssetPath<'static>,
    /// What was found and what to do about it.
    pub error: String,
}

/// What bakes tell the game, in the order it happened.
#[derive(Debug)]
pub(super) enum Event {
    /// A model is to have the levels of a key; they are still to be made, or the cache has them.
    Wished {
        path: AssetPath<'static>,
        key: Key,
        cached: bool,
    },
    Started(Key, BakeStarted),
    Progress(Key, BakeProgress),
    Finished(Key, BakeFinished),
    /// Without a key if the model's settings do not even make one.
    Failed(Option<Key>, BakeFailed),
    /// A model was exchanged and nobody watches its file.
    Exchanged(AssetPath<'static>),
}

/// The game's end of the channel.
#[derive(Resource)]
pub(super) struct EventReceiver(pub(super) async_channel::Receiver<Event>);

/// Turns what was heard since the last frame into messages.
pub(super) fn deliver(
    receiver: Res<EventReceiver>,
    server: Res<AssetServer>,
    mut bakes: ResMut<Bakes>,
    mut started: MessageWriter<BakeStarted>,
    mut progress: MessageWriter<BakeProgress>,
    mut finished: MessageWriter<BakeFinished>,
    mut failed: MessageWriter<BakeFailed>,
) {
    while let Ok(event) = receiver.0.try_recv() {
        match event {
            Event::Wished { path, key, cached: false } => bakes.wish(&path, Some(key), BakeStatus::Queued),
            Event::Wished { path, key, cached: true } => {
                bakes.wish(&path, Some(key), BakeStatus::Done { duration: Duration::ZERO });
            }
            Event::Started(key, message) => {
                bakes.advance(&message.path, key, BakeStatus::Baking { stage: StageId::Import, fraction: 0.0 });
                started.write(message);
            }
            Event::Progress(key, message) => {
                let BakeProgress { stage, fraction, .. } = message;
                bakes.advance(&message.path, key, BakeStatus::Baking { stage, fraction });
                progress.write(message);
            }
            Event::Finished(key, message) => {
                bakes.advance(&message.path, key, BakeStatus::Done { duration: message.duration });
                finished.write(message);
            }
            Event::Failed(key, message) => {
                let status = BakeStatus::Failed { error: message.error.clone() };
                match key {
                    Some(key) => bakes.advance(&message.path, key, status),
                    None => bakes.wish(&message.path, None, status),
                }
                failed.write(message);
            }
            Event::Exchanged(path) if !server.watching_for_changes() => server.reload(path),
            Event::Exchanged(_) => {}
        }
    }
}
