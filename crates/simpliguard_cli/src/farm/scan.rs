//! The scan of a library: the key of each model, and the tier that has its result.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf, absolute};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use simpliguard::Error;
use simpliguard::settings::BakeSettings;
use simpliguard_bake::{CachePlace, CachedBake, Parts};
use simpliguard_cache::{Cache, Flight, Key, TierName};

use super::args::PlanArgs;
use super::cost::{Cost, Size};
use crate::console;
use crate::error::UsageError;
use crate::inputs;
use crate::plan::without_repetition;
use crate::project::{ProjectCache, SettingsLookup};
use crate::source::SourceFile;

/// Number of models that are looked up at a time. Most of the time is spent waiting for the shared tier.
const LOOKUPS: usize = 16;

/// A model to look up.
struct Candidate {
    name: String,
    path: PathBuf,
    settings: Result<BakeSettings, Error>,
    cache: ProjectCache,
}

/// A model that was looked up.
pub(super) struct Scanned {
    pub(super) name: String,
    /// Absolute.
    pub(super) path: PathBuf,
    pub(super) cache: ProjectCache,
    /// `Err` holds the reason why it cannot be baked.
    pub(super) found: Result<Found, String>,
}

/// What a bake of a model is.
pub(super) struct Found {
    pub(super) key: Key,
    /// The tier that has its result.
    pub(super) tier: Option<TierName>,
    pub(super) cost: Cost,
    /// The files that the bake reads, absolute, the model first.
    pub(super) files: Vec<PathBuf>,
}

/// The caches of all projects of a library.
pub(super) struct Caches {
    caches: BTreeMap<ProjectCache, Option<Cache>>,
    /// Warnings that were printed. One that holds for many models is printed once.
    said: Mutex<BTreeSet<String>>,
}

impl Caches {
    /// Opens the caches of `projects`. `place` is from the command line.
    pub(super) fn open<'a>(projects: impl IntoIterator<Item = &'a ProjectCache>, place: CachePlace<'_>) -> Self {
        let said = RefCell::default();
        let mut caches = BTreeMap::new();
        for project in projects {
            let open = || project.open(place, |outside| warn_once(&mut said.borrow_mut(), &outside.to_string()));
            caches.entry(project.clone()).or_insert_with(open);
        }
        Self { caches, said: Mutex::new(said.into_inner()) }
    }

    /// The cache of a project, if there is a place for one.
    pub(super) fn of(&self, project: &ProjectCache) -> Option<&Cache> {
        self.caches.get(project)?.as_ref()
    }

    /// The tier that has the result of a key.
    pub(super) fn locate(&self, project: &ProjectCache, key: &Key) -> Option<TierName> {
        let notify = |notice: simpliguard_cache::Notice| {
            warn_once(&mut self.said.lock().unwrap_or_else(PoisonError::into_inner), &notice.to_string());
        };
        let flight = Flight { key, is_cancelled: &|| false, notify: &notify, check: |_| Ok(true) };
        self.of(project)?.locate(&flight)
    }
}

fn warn_once(said: &mut BTreeSet<String>, text: &str) {
    if said.insert(text.to_owned()) {
        console::warning(text);
    }
}

/// Threads for look-ups. They wait more than they compute, so there are more of them than cores.
pub(super) fn lookup_pool() -> Result<ThreadPool, UsageError> {
    let pool = ThreadPoolBuilder::new().num_threads(LOOKUPS).build();
    pool.map_err(|e| UsageError(format!("cannot start the threads that look models up: {e}")))
}

/// Looks all models of a command line up, in the order of its inputs. The second value is the project of all models, if
/// the command line gives one.
pub(super) fn scan(args: &PlanArgs, place: CachePlace<'_>) -> Result<(Vec<Scanned>, Option<PathBuf>), UsageError> {
    let mut lookup = SettingsLookup::new(&args.settings)?;
    let inputs = inputs::find(&args.assets, Path::new(""), lookup.fixed_project())?;
    let mut candidates = Vec::new();
    for input in without_repetition(inputs) {
        let settings = lookup.of(&input.path)?;
        candidates.push(Candidate {
            name: input.path.display().to_string(),
            path: input.path,
            settings: settings.resolved.map(|resolved| resolved.settings),
            cache: settings.cache,
        });
    }
    let caches = Caches::open(candidates.iter().map(|candidate| &candidate.cache), place);
    let look_up = |candidate: Candidate| candidate.look_up(&caches);
    let scanned = lookup_pool()?.install(|| candidates.into_par_iter().map(look_up).collect());
    Ok((scanned, lookup.fixed_project().map(Path::to_owned)))
}

impl Candidate {
    fn look_up(self, caches: &Caches) -> Scanned {
        let path = absolute(&self.path).unwrap_or_else(|_| self.path.clone());
        let found = self.find(&path, caches).map_err(|error| error.to_string());
        Scanned { name: self.name, path, cache: self.cache, found }
    }

    fn find(&self, path: &Path, caches: &Caches) -> Result<Found, Error> {
        let settings = self.settings.as_ref().map_err(|error| Error::Settings(error.to_string()))?;
        let file = SourceFile::read(path, &self.name, self.cache.project())?;
        let cache = caches.of(&self.cache);
        let key = CachedBake::new(file.source(), settings, Parts::Levels, cache)?.key();
        let tier = caches.locate(&self.cache, &key);
        let cost = Cost::of(Size::of(&file.source()), settings);
        let meta = Some(with_meta(path)).filter(|meta| meta.is_file());
        let files = [path.to_owned()].into_iter().chain(meta).chain(file.files_beside()).collect();
        Ok(Found { key, tier, cost, files })
    }
}

/// The path of the settings beside a model.
fn with_meta(path: &Path) -> PathBuf {
    let mut meta = path.as_os_str().to_owned();
    meta.push(".meta");
    meta.into()
}
