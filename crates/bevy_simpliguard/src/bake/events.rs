//! What a game hears of the bakes of its models.

use std::time::Duration;

use bevy::asset::AssetPath;
use bevy::prelude::*;
use simpliguard::{Report, StageId};

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
    Started(BakeStarted),
    Progress(BakeProgress),
    Finished(BakeFinished),
    Failed(BakeFailed),
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
    mut started: MessageWriter<BakeStarted>,
    mut progress: MessageWriter<BakeProgress>,
    mut finished: MessageWriter<BakeFinished>,
    mut failed: MessageWriter<BakeFailed>,
) {
    while let Ok(event) = receiver.0.try_recv() {
        match event {
            Event::Started(message) => {
                started.write(message);
            }
            Event::Progress(message) => {
                progress.write(message);
            }
            Event::Finished(message) => {
                finished.write(message);
            }
            Event::Failed(message) => {
                failed.write(message);
            }
            Event::Exchanged(path) if !server.watching_for_changes() => server.reload(path),
            Event::Exchanged(_) => {}
        }
    }
}
