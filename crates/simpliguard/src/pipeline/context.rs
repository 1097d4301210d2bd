//! What surrounds a bake: cancellation, progress, and what earlier bakes left behind. Never the data being baked.

use bytes::Bytes;

use crate::{Cancellation, Error, Key, StageId};

/// How far a bake is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The stage at work.
    pub stage: StageId,
    /// The level at work, counted from 1, or `None` while the stage serves all levels.
    pub level: Option<usize>,
    /// Part of the whole bake that is done, 0 to 1; never falls.
    pub fraction: f32,
}

/// Receives [`Progress`]; called from worker threads.
pub trait ProgressSink: Sync {
    /// Takes one report. Must return quickly.
    fn report(&self, progress: Progress);
}

/// Keeps what stages have made, so that a later bake that differs in other stages need not make it again. It may forget
/// anything at any time; what it returns must be what was stored. Called from worker threads.
pub trait StageStore: Sync {
    /// What was stored under a key, if it is still there and undamaged.
    fn get(&self, key: &Key) -> Option<Bytes>;
    /// Stores an object, or not.
    fn put(&self, key: &Key, bytes: &[u8]);
}

/// Takes levels that can be shown while better ones are made; called from a worker thread.
pub trait PreviewSink: Sync {
    /// Takes one binary glTF: the source, and behind it the levels with their texture as it was baked, on vertices as an
    /// earlier bake with another texture has refined them, if `stages` knows any.
    fn show(&self, glb: Vec<u8>);
}

/// The surroundings of one bake.
#[derive(Clone, Default)]
pub struct Context<'a> {
    /// Looked at between and within stages.
    pub cancellation: Cancellation,
    /// Told about every stage as it begins.
    pub progress: Option<&'a dyn ProgressSink>,
    /// Asked before the costly stages. Changes no byte of the result.
    pub stages: Option<&'a dyn StageStore>,
    /// Shown levels where they are there long before the result: `stages` knows their shapes and not their descent, as after
    /// a change of a texture. Changes no byte of the result.
    pub preview: Option<&'a dyn PreviewSink>,
}

impl Context<'_> {
    /// `Err` once the bake is cancelled.
    pub fn check(&self, asset: &str) -> Result<(), Error> {
        self.cancellation.check(asset)
    }

    /// Passes a report on to the sink.
    pub fn report(&self, stage: StageId, level: Option<usize>, fraction: f32) {
        if let Some(sink) = self.progress {
            sink.report(Progress { stage, level, fraction });
        }
    }
}
