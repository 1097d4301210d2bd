//! The surroundings of a bake: cancellation, progress, and the store of earlier bakes. Never the data being baked.

use bytes::Bytes;

use crate::refine::Device;
use crate::{Cancellation, Error, Key, StageId};

/// How far a bake is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The stage at work.
    pub stage: StageId,
    /// The level at work, counted from 1, or `None` while the stage serves all levels.
    pub level: Option<usize>,
    /// Fraction of the whole bake that is done, 0 to 1. It never falls.
    pub fraction: f32,
}

/// Receives [`Progress`]; called from worker threads.
pub trait ProgressSink: Sync {
    /// Takes one report. Must return quickly.
    fn report(&self, progress: Progress);
}

/// Keeps the results of stages, so that a later bake with other parameters for later stages does not compute them again.
/// The store may forget anything at any time. It returns the bytes that were stored. Called from worker threads.
pub trait StageStore: Sync {
    /// The object stored under a key, if it is still there and undamaged.
    fn get(&self, key: &Key) -> Option<Bytes>;
    /// Stores an object. A store that cannot do so forgets it.
    fn put(&self, key: &Key, bytes: &[u8]);
}

/// Takes levels that can be shown while better ones are made; called from a worker thread.
pub trait PreviewSink: Sync {
    /// Takes one binary glTF: the source, and behind it the levels with their initial texture. Their vertices are those of
    /// an earlier bake with another texture, if the store holds them. Of a scene, the levels of its objects.
    fn show(&self, glb: Vec<u8>);
}

/// The surroundings of one bake.
#[derive(Clone, Default)]
pub struct Context<'a> {
    /// Looked at between and within stages.
    pub cancellation: Cancellation,
    /// Receives every stage as it begins.
    pub progress: Option<&'a dyn ProgressSink>,
    /// Asked before the costly stages. Changes no byte of the result.
    pub stages: Option<&'a dyn StageStore>,
    /// Shown the levels where they are ready long before the result: the store holds their shapes but not their refined
    /// vertices, as after a change of a texture; or the objects of a scene have theirs, and those that stand for all of them
    /// are missing. Changes no byte of the result.
    pub preview: Option<&'a dyn PreviewSink>,
    /// Memory in bytes that the bake may take, estimated before it is allocated; `None` for that of
    /// [`ImportLimits`](crate::gltf::ImportLimits). Changes no byte of the result: a model that would take more is refused.
    pub memory: Option<u64>,
    /// Refines the levels; the CPU does if there is none, or if it fails. It changes the result by rounding alone, and is part
    /// of no key.
    pub device: Option<&'a Device>,
}

impl Context<'_> {
    /// `Err` once the bake is cancelled.
    pub fn check(&self, asset: &str) -> Result<(), Error> {
        self.cancellation.check(asset)
    }
}
