//! Decides what the processor writes for a model, and what is baked for it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use bevy::asset::AssetPath;
use bevy::asset::io::AssetSourceId;
use bevy::platform::collections::HashSet;
use bevy::prelude::*;
use bytes::Bytes;
use simpliguard::Error;
use simpliguard::settings::{BakeSettings, CacheSettings, Layer, Origin, ProjectFile, parse_meta, resolve};
use simpliguard_cache::{BakeResult, Cache, Explicit, Key, Lookup, OutsideProject, bake_key};

use super::activity::Activity;
use super::events::{BakeFailed, Event};
use super::input::Input;
use super::journal::Journal;
use super::project::Project;
use super::queue::{Job, Queue};
use crate::BakeMode;

/// One bake: what makes its result what it is, and where results are kept.
#[derive(Clone, Debug)]
pub(super) struct Order {
    pub(super) path: AssetPath<'static>,
    pub(super) settings: BakeSettings,
    pub(super) key: Key,
    /// `None` if there is no place for one.
    pub(super) cache: Option<Arc<Cache>>,
}

impl Order {
    /// The result without its single levels, if somebody has made it.
    pub(super) fn cached(&self) -> Option<BakeResult> {
        match self.cache.as_ref()?.get_objects(&self.key, BakeResult::is_whole) {
            Lookup::Hit(entry) => BakeResult::from_entry(entry),
            Lookup::Miss => None,
            Lookup::Damaged(error) => {
                warn!("{}: {error}", self.path);
                None
            }
        }
    }
}

/// What all models of a game share.
pub(super) struct Baker {
    pub(super) project: Project,
    pub(super) mode: BakeMode,
    /// As the game asks for it.
    pub(super) cache_dir: Option<PathBuf>,
    pub(super) journal: Journal,
    pub(super) activity: Arc<Activity>,
    pub(super) queue: Arc<Queue>,
    pub(super) events: async_channel::Sender<Event>,
    /// By what the project's file said of it: that may change while the game runs.
    pub(super) caches: Mutex<BTreeMap<CacheSettings, Arc<Cache>>>,
    /// Models that were processed since the start.
    pub(super) seen: Mutex<HashSet<AssetPath<'static>>>,
}

impl Baker {
    /// The processed file of a model: with levels if they are in the cache or worth waiting for, else the model itself,
    /// whose levels follow.
    pub(super) async fn output_for(&self, path: &AssetPath<'static>, input: Input) -> Bytes {
        let order = match self.order(path, &input) {
            Ok(order) => order,
            Err(error) => return self.without_levels(path, &input, &error),
        };
        if let Some(found) = order.cached() {
            debug!("{path}: levels from the cache");
            let missing = input.files.missing(path);
            self.tell(Event::Wished { path: path.clone(), key: order.key, cached: missing.is_empty() });
            if missing.is_empty() {
                self.queue.forget(path);
                self.settle(&order);
            } else {
                self.queue.push(Job::once_there(order, blake3::hash(&found.combined), missing));
            }
            return found.combined.into();
        }
        self.note_pending(path);
        self.tell(Event::Wished { path: path.clone(), key: order.key, cached: false });
        let first = self.seen.lock().unwrap_or_else(PoisonError::into_inner).insert(path.clone());
        let exchangeable = *path.source() == AssetSourceId::Default;
        // Bevy may stop for good if a second change meets a long wait, so only the first is waited for.
        if first && (self.mode == BakeMode::Blocking || !exchangeable) {
            let answer = self.wait_for(order).await;
            return answer.unwrap_or_else(|| self.meanwhile(path, &input));
        }
        let meanwhile = self.meanwhile(path, &input);
        if exchangeable {
            self.queue.push(Job::in_background(order, blake3::hash(&meanwhile)));
        }
        meanwhile
    }

    /// Everything about the model is well, now and at the next start.
    pub(super) fn settle(&self, order: &Order) {
        let noted = self.journal.end(&order.path).and_then(|()| self.journal.set_good(&order.path, &order.key.hex()));
        if let Err(error) = noted {
            warn!("{}: {error}", order.path);
        }
    }

    pub(super) fn tell(&self, event: Event) {
        // Nobody listens when the game has ended.
        let _ = self.events.try_send(event);
    }

    /// `key` is that of the bake, if it came so far.
    pub(super) fn fail(&self, path: &AssetPath<'static>, key: Option<Key>, error: String) {
        error!("{error}");
        self.tell(Event::Failed(key, BakeFailed { path: path.clone(), error }));
    }

    fn order(&self, path: &AssetPath<'static>, input: &Input) -> Result<Order, Error> {
        let bytes = input.project.as_ref().map_err(|e| Error::Settings(format!("{}: {e}", ProjectFile::PATH)))?;
        let project = self.project.parse(bytes)?;
        let mut layers = project.layers(&slashed(path.path()), self.project.profile.as_deref())?;
        if let Some(text) = &input.meta {
            let file = format!("{path}.meta");
            let overrides = parse_meta(text, &file)?;
            layers.extend(overrides.map(|overrides| Layer { origin: Origin::Meta { file }, overrides }));
        }
        let settings = resolve(layers)?.settings;
        let key = bake_key(&input.files.source(), &settings)?;
        Ok(Order { path: path.clone(), settings, key, cache: self.cache(&project) })
    }

    fn cache(&self, project: &ProjectFile) -> Option<Arc<Cache>> {
        let settings = &project.project.cache;
        let mut caches = self.caches.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = caches.get(settings) {
            return Some(known.clone());
        }
        let explicit = Explicit { dir: self.cache_dir.as_deref(), shared: None };
        let tell = |outside: OutsideProject| warn!("{outside}");
        let cache = Arc::new(Cache::of_project(explicit, settings, &self.project.base, tell)?);
        caches.insert(settings.clone(), cache.clone());
        Some(cache)
    }

    async fn wait_for(&self, order: Order) -> Option<Bytes> {
        let (job, answer) = Job::awaited(order);
        self.queue.push(job);
        answer.recv().await.ok()
    }

    /// For a model with mistakes around it that say how it is to be baked.
    fn without_levels(&self, path: &AssetPath<'static>, input: &Input, error: &Error) -> Bytes {
        self.queue.forget(path);
        // At the next start the message comes again, or nothing if the mistake was mended meanwhile.
        self.note_pending(path);
        self.fail(path, None, error.to_string());
        self.meanwhile(path, input)
    }

    fn note_pending(&self, path: &AssetPath<'static>) {
        if let Err(error) = self.journal.begin(path) {
            warn!("{path}: should the game end before the bake, the model has to be saved again: {error}");
        }
    }

    /// The model itself, or what was last made of it if it is one that Bevy cannot load.
    fn meanwhile(&self, path: &AssetPath<'static>, input: &Input) -> Bytes {
        let source = input.files.bytes();
        match gltf::Gltf::from_slice(source) {
            Ok(_) => source.clone(),
            Err(_) => self.last_good(path, input).unwrap_or_else(|| source.clone()),
        }
    }

    fn last_good(&self, path: &AssetPath<'static>, input: &Input) -> Option<Bytes> {
        let project = self.project.parse(input.project.as_ref().ok()?).ok()?;
        let key = Key::from_hex(&self.journal.good(path)?)?;
        let lookup = self.cache(&project)?.get_objects(&key, BakeResult::is_whole);
        let Lookup::Hit(entry) = lookup else { return None };
        info!("{path}: its latest levels stay");
        Some(BakeResult::from_entry(entry)?.combined.into())
    }
}

/// A path with its parts separated by `/`.
fn slashed(path: &Path) -> String {
    let text = path.to_string_lossy();
    if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() }
}
