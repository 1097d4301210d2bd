//! `simpliguard cache verify --rebake`: bakes a sample again, and compares it with the cache.
//!
//! Hashes tell that a result is what somebody has stored. Only another bake tells that it is what this program makes.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;
use simpliguard::settings::{BackendChoice, BakeSettings};
use simpliguard::{Context, Error, KeyBuilder};
use simpliguard_bake::{BakeResult, CachePlace, CachedBake, Host, Notice, Parts, default_memory, look_up};

use crate::args::CacheArgs;
use crate::console;
use crate::error::UsageError;
use crate::inputs;
use crate::plan::without_repetition;
use crate::project::{ModelSettings, SettingsLookup};
use crate::settings_sources::SettingsSources;
use crate::source::SourceFile;

/// The outcome.
#[derive(Debug, Default, Serialize)]
pub(super) struct Rebaked {
    /// Number of models whose results are in the cache.
    found: usize,
    /// Number of these that were baked again.
    rebaked: usize,
    /// Models whose bytes differ, and models that failed.
    errors: Vec<String>,
}

/// A model whose result is in the cache.
struct Sample {
    file: SourceFile,
    name: String,
    settings: BakeSettings,
    stored: BakeResult,
    /// Decides whether it is in the sample.
    rank: String,
}

struct Quiet;

impl Host for Quiet {
    fn notify(&self, notice: Notice) {
        console::warning(&notice.to_string());
    }
}

/// Bakes a fraction of the models that are in the cache again, at least one. Each run takes another sample.
pub(super) fn rebake(assets: &[PathBuf], args: &CacheArgs, fraction: f64) -> Result<Rebaked, UsageError> {
    let sources = SettingsSources { project: args.project.clone(), ..SettingsSources::default() };
    let mut lookup = SettingsLookup::new(&sources)?;
    let inputs = without_repetition(inputs::find(assets, Path::new(""), lookup.fixed_project())?);
    let mut ranked = Vec::new();
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_nanos() as u64);
    for input in inputs {
        let settings = lookup.of(&input.path)?;
        if let Some(sample) = find(&input.path, settings, args, now) {
            ranked.push((sample.rank, input.path));
        }
    }
    ranked.sort();
    let mut outcome = Rebaked { found: ranked.len(), ..Rebaked::default() };
    let number = (ranked.len() as f64 * fraction).ceil() as usize;
    // Each is read once more, so that not all of the results are in memory.
    for (_, path) in ranked.into_iter().take(number) {
        let settings = lookup.of(&path)?;
        if let Some(sample) = find(&path, settings, args, now) {
            outcome.rebaked += 1;
            outcome.errors.extend(sample.compare().err());
        }
    }
    Ok(outcome)
}

/// A model and its result in the cache. `None` if it is not there, or the model cannot be baked.
fn find(path: &Path, settings: ModelSettings, args: &CacheArgs, seed: u64) -> Option<Sample> {
    let name = path.display().to_string();
    let resolved = settings.resolved.ok()?.settings;
    let file = SourceFile::read(path, &name, settings.cache.project()).ok()?;
    let explicit = CachePlace { dir: args.cache_dir.as_deref(), shared: None };
    let cache = settings.cache.open(explicit, |_| {})?;
    let key = CachedBake::new(file.source(), &resolved, Parts::Levels, None).ok()?.key();
    let stored = look_up(&cache, &key, Parts::Levels, |notice| console::warning(&notice.to_string()))?;
    let rank = KeyBuilder::new("rebake").key(&key).params(&seed).finish().hex();
    Some(Sample { file, name, settings: resolved, stored, rank })
}

impl Sample {
    fn compare(&self) -> Result<(), String> {
        let again = self.bake().map_err(|error| error.to_string())?;
        let entry = |result: &BakeResult| result.to_entry().map_err(|e| format!("{}: {e}", self.name));
        let (stored, made) = (entry(&self.stored)?, entry(&again)?);
        let differs = made.objects.iter().find(|(name, bytes)| stored.object(name) != Some(bytes));
        match differs {
            Some(_) if self.stored.report.device() != again.report.device() => Err(format!(
                "{}: it was refined on {}, and here on {}: a comparison needs the same processor",
                self.name,
                processor(&self.stored),
                processor(&again)
            )),
            Some((object, _)) => Err(format!(
                "{}: baked again, its {object} differs from the one in the cache: clear the cache, and find out who wrote it",
                self.name
            )),
            None => Ok(()),
        }
    }

    fn bake(&self) -> Result<BakeResult, Error> {
        let context = Context { memory: Some(default_memory()), ..Context::default() };
        let is_of_gpu = self.stored.report.device().is_some();
        let backend = if is_of_gpu { BackendChoice::Gpu } else { BackendChoice::Cpu };
        let bake = CachedBake::new(self.file.source(), &self.settings, Parts::Levels, None)?.on(backend);
        Ok(bake.run(&context, &Quiet)?.result)
    }
}

fn processor(result: &BakeResult) -> &str {
    result.report.device().unwrap_or("the CPU")
}

impl Rebaked {
    pub(super) fn errors(&self) -> impl Iterator<Item = &str> {
        self.errors.iter().map(String::as_str)
    }

    pub(super) fn text(&self) -> String {
        let Self { found, rebaked, errors } = self;
        format!("baked {rebaked} of {found} models in the cache again: {} differ or failed\n", errors.len())
    }
}
