//! Runs stages. Owns what every stage needs: cancellation, progress, seconds and the stage store.

use std::sync::{Arc, OnceLock};

use super::clock::Clock;
use super::context::Context;
use super::meter::Meter;
use super::report::StageSeconds;
use super::store::{Stored, decode, encode};
use crate::refine::{Device, DeviceError};
use crate::render::View;
use crate::{Cancellation, Error, Key, PreviewSink, StageId, StageStore};

/// The runner of one bake, or of one of its levels.
#[derive(Clone)]
pub(crate) struct Runner<'a> {
    asset: &'a str,
    context: &'a Context<'a>,
    clock: Arc<Clock>,
    /// `None` if nobody listens.
    meter: Option<Arc<Meter<'a>>>,
    /// Shown early levels, if it wants any.
    preview: Option<&'a dyn PreviewSink>,
    /// Number of the level, counted from 1.
    level: Option<usize>,
    /// Results are read from the store and put into it, if there is one.
    uses_store: bool,
    /// The failure of the device, once it has failed.
    device_failure: Arc<OnceLock<String>>,
}

impl<'a> Runner<'a> {
    pub(crate) fn new(asset: &'a str, context: &'a Context<'a>) -> Self {
        let meter = context.progress.map(|sink| Arc::new(Meter::new(sink)));
        Self {
            asset,
            context,
            clock: Arc::default(),
            meter,
            preview: context.preview,
            level: None,
            uses_store: true,
            device_failure: Arc::default(),
        }
    }

    /// The runner of a level; levels count from 1.
    pub(crate) fn level(&self, number: usize) -> Self {
        Self { level: Some(number), ..self.clone() }
    }

    /// A runner that reports no progress and shows no preview.
    pub(crate) fn silent(&self) -> Self {
        Self { meter: None, preview: None, ..self.clone() }
    }

    /// A runner for results that nobody needs later: it neither stores nor reports progress.
    pub(crate) fn trial(&self) -> Self {
        Self { uses_store: false, ..self.silent() }
    }

    fn store(&self) -> Option<&'a dyn StageStore> {
        self.context.stages.filter(|_| self.uses_store)
    }

    /// Announces the number of levels.
    pub(crate) fn expect_levels(&self, count: usize) {
        self.meter.iter().for_each(|meter| meter.expect_levels(count));
    }

    /// Reports that everything is done.
    pub(crate) fn finish(&self) {
        self.meter.iter().for_each(|meter| meter.finish());
    }

    /// Takes levels that can be shown early.
    pub(crate) fn preview(&self) -> Option<&'a dyn PreviewSink> {
        self.preview
    }

    pub(crate) fn context(&self) -> &'a Context<'a> {
        self.context
    }

    pub(crate) fn cancellation(&self) -> &'a Cancellation {
        &self.context.cancellation
    }

    /// The device that works on levels with `views` and a texture of `size` x `size` texels, unless there is none, it is too
    /// small, or it has failed.
    pub(crate) fn device(&self, views: &[View], size: usize) -> Option<&'a Device> {
        let device = self.context.device.filter(|_| self.device_failure.get().is_none())?;
        device.can_hold(views.first()?.image.size, size).then_some(device)
    }

    /// Does without the device from now on.
    pub(crate) fn give_up_device(&self, device: &Device, error: &DeviceError) {
        let name = device.name();
        let warned = format!("the GPU '{name}' failed, and levels are refined on the CPU instead: {error}");
        if self.device_failure.set(warned.clone()).is_ok() {
            tracing::warn!(asset = self.asset, "{warned}");
        }
    }

    /// What the user should know of the device, in words.
    pub(crate) fn device_failure(&self) -> Option<String> {
        self.device_failure.get().cloned()
    }

    /// Seconds of the stages that have run.
    pub(crate) fn seconds(&self) -> StageSeconds {
        self.clock.seconds()
    }

    /// `Err` once the bake is cancelled.
    pub(crate) fn check(&self) -> Result<(), Error> {
        self.context.check(self.asset)
    }

    /// Runs a stage. Work that holds the cancellation may end early; its unfinished result is discarded here.
    pub(crate) fn run<T>(&self, stage: StageId, work: impl FnOnce() -> T) -> Result<T, Error> {
        self.check()?;
        self.meter.iter().for_each(|meter| meter.begin(stage, self.level));
        let out = self.time(stage, work);
        self.check()?;
        Ok(out)
    }

    /// Checks the result of a stage, in debug builds alone. What a cancelled stage leaves is unfinished, and nobody takes it.
    ///
    /// # Panics
    /// If the result breaks the rules of its type. That is a bug in the stage, whatever the input was.
    pub(crate) fn validate(&self, stage: StageId, check: impl FnOnce() -> Result<(), String>) {
        if cfg!(debug_assertions)
            && let Err(found) = check()
            && !self.cancellation().is_cancelled()
        {
            panic!("{}: {stage}: {found}", self.asset);
        }
    }

    /// Runs a stage, unless the store holds its result under `key`. A new result is stored.
    pub(crate) fn stored<T: Stored>(
        &self,
        stage: StageId,
        key: Option<Key>,
        work: impl FnOnce() -> Result<T, Error>,
    ) -> Result<T, Error> {
        self.run(stage, || self.get_or_put(key, work))?
    }

    /// The object of `key`, or else the result of `work`, which is stored.
    pub(crate) fn get_or_put<T: Stored>(
        &self,
        key: Option<Key>,
        work: impl FnOnce() -> Result<T, Error>,
    ) -> Result<T, Error> {
        let Some(key) = key else { return work() };
        if let Some(object) = self.get(&key) {
            return Ok(object);
        }
        let made = work()?;
        self.put(&key, &made);
        Ok(made)
    }

    /// Adds the time of `work` to a stage.
    pub(crate) fn time<T>(&self, stage: StageId, work: impl FnOnce() -> T) -> T {
        self.clock.time(stage, work)
    }

    /// The key of an object, if there is a store.
    pub(crate) fn key(&self, key: impl FnOnce() -> Key) -> Option<Key> {
        self.store().map(|_| key())
    }

    /// The store holds an object under `key`.
    pub(crate) fn knows(&self, key: Option<Key>) -> bool {
        let object = self.store().zip(key).and_then(|(stages, key)| stages.get(&key));
        object.is_some()
    }

    /// The object of a key, if it is stored.
    pub(crate) fn get<T: Stored>(&self, key: &Key) -> Option<T> {
        self.store()?.get(key).and_then(|bytes| decode(&bytes))
    }

    /// Stores an object. A cancelled bake may have made less than everything and stores nothing.
    pub(crate) fn put<T: Stored>(&self, key: &Key, object: &T) {
        if let Some(stages) = self.store().filter(|_| !self.cancellation().is_cancelled()) {
            stages.put(key, &encode(object));
        }
    }
}
