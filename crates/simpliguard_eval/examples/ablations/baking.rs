//! Bakes of one source under many settings: what they share is made once.

use std::collections::HashMap;
use std::error::Error;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use bytes::Bytes;
use simpliguard::data::Model;
use simpliguard::settings::{BakeOverrides, BakeSettings, Layer, Origin, resolve};
use simpliguard::{Baked, Context, Key, NoResources, Source, StageStore, bake};

/// Stages kept in memory.
#[derive(Default)]
struct Stages(Mutex<HashMap<Key, Bytes>>);

impl StageStore for Stages {
    fn get(&self, key: &Key) -> Option<Bytes> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(key).cloned()
    }

    fn put(&self, key: &Key, bytes: &[u8]) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(*key, Bytes::copy_from_slice(bytes));
    }
}

/// A source and what bakes of it have left behind.
pub(crate) struct Bakery {
    pub(crate) name: String,
    bytes: Vec<u8>,
    stages: Stages,
}

/// One bake and the seconds it took.
pub(crate) struct Timed {
    pub(crate) baked: Baked,
    pub(crate) seconds: f64,
}

impl Bakery {
    pub(crate) fn new(name: &str, bytes: Vec<u8>) -> Self {
        Self { name: name.to_owned(), bytes, stages: Stages::default() }
    }

    pub(crate) fn open(path: &Path) -> Result<Self, Box<dyn Error>> {
        let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(Self::new(&path.file_stem().unwrap_or_default().to_string_lossy(), bytes))
    }

    /// A bake that takes over what earlier ones have made, if `share`; else its seconds are those of a whole bake.
    pub(crate) fn bake(&self, settings: &BakeSettings, share: bool) -> Result<Timed, Box<dyn Error>> {
        let source = Source { name: &self.name, bytes: &self.bytes, resources: &NoResources };
        let stages: Option<&dyn StageStore> = if share { Some(&self.stages) } else { None };
        let start = Instant::now();
        let baked = bake(&source, settings, &Context { stages, ..Context::default() })?;
        let seconds = start.elapsed().as_secs_f64();
        if baked.levels.is_empty() {
            return Err(format!("{} gets no levels: it has {} faces", self.name, baked.report.source_faces).into());
        }
        Ok(Timed { baked, seconds })
    }
}

impl Timed {
    pub(crate) fn model(&self) -> Result<&Model, Box<dyn Error>> {
        self.baked.model.as_ref().ok_or_else(|| "a bake with levels has a model".into())
    }

    /// Seconds in a stage, summed over levels.
    pub(crate) fn stage(&self, name: &str) -> f64 {
        self.baked.report.seconds.iter().filter(|(stage, _)| stage == name).fold(0.0, |sum, (_, seconds)| sum + seconds)
    }
}

/// Built-in values with `overrides` on top.
pub(crate) fn resolved(overrides: &BakeOverrides) -> Result<BakeSettings, Box<dyn Error>> {
    Ok(resolve(vec![Layer { origin: Origin::CommandLine, overrides: overrides.clone() }])?.settings)
}
