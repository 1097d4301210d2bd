//! The baker: decides on the processed file of a model, and queues its bake.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bevy::asset::AssetPath;
use bevy::asset::io::AssetSourceId;
use bevy::image::ImageFormat;
use bevy::platform::collections::HashSet;
use bevy::prelude::*;
use bytes::Bytes;
use simpliguard::settings::{BakeSettings, CacheSettings, Layer, Origin, ProjectFile, parse_meta, resolve};
use simpliguard::{Context, Error, Key};
use simpliguard_bake::{CachePlace, CachedBake, OutsideProject, Parts, look_up, open_cache};
use simpliguard_cache::Cache;

use super::activity::ProcessorActivity;
use super::attempts::Attempts;
use super::events::{BakeFailed, BakeFinished, Event};
use super::input::Input;
use super::journal::Journal;
use super::project::Project;
use super::queue::{Job, Queue};
use super::request::BakeRequest;
use super::sources::processed_file;
use crate::options::BakeMode;

/// The MIME type of WebP images.
const WEBP: &str = "image/webp";

/// The state that the bakes of all models of a game share.
pub(super) struct Baker {
    pub(super) project: Project,
    pub(super) mode: BakeMode,
    /// Folder of the cache, if the game gives one.
    pub(super) cache_dir: Option<PathBuf>,
    /// Memory in bytes that one bake may take.
    pub(super) memory: u64,
    /// Bakes run in processes of their own.
    pub(super) isolate: bool,
    pub(super) journal: Journal,
    pub(super) attempts: Attempts,
    pub(super) activity: Arc<ProcessorActivity>,
    pub(super) queue: Arc<Queue>,
    pub(super) events: async_channel::Sender<Event>,
    /// Caches by the settings in the project's file, which may change while the game runs.
    pub(super) caches: Mutex<BTreeMap<CacheSettings, Arc<Cache>>>,
    /// Models that were processed since the start of the game.
    pub(super) seen: Mutex<HashSet<AssetPath<'static>>>,
}

impl Baker {
    /// The processed file of a model: with levels if the cache has them or if the game waits for them. Otherwise the
    /// model itself, and its levels follow.
    pub(super) async fn output_for(&self, path: &AssetPath<'static>, input: Input) -> Bytes {
        let request = match self.request(path, &input) {
            Ok(request) => request,
            Err(error) => return self.without_levels(path, &input, &error),
        };
        let missing = input.files.missing(path);
        if let Some(found) = request.cached() {
            debug!("{path}: levels from the cache");
            self.tell(Event::Desired { path: path.clone(), key: request.key, is_cached: missing.is_empty() });
            let processed = processed_file(&self.journal, path, &request.settings, found.combined);
            if missing.is_empty() {
                // A bake that was asked for these levels before is not needed any more, but the game waits for its end.
                let is_awaited = self.queue.forget(path) == Some(request.key);
                self.settle(&request);
                if is_awaited {
                    let (path, duration) = (path.clone(), Duration::ZERO);
                    let finished = BakeFinished { path, report: found.report, duration };
                    self.tell(Event::Finished(request.key, finished));
                }
            } else {
                self.queue.push(Job::when_there(request, blake3::hash(&processed), missing));
            }
            return processed.into();
        }
        self.note_pending(path);
        self.tell(Event::Desired { path: path.clone(), key: request.key, is_cached: false });
        let first = self.seen.lock().unwrap_or_else(PoisonError::into_inner).insert(path.clone());
        let can_swap = *path.source() == AssetSourceId::Default;
        // Only the first bake is waited for: Bevy's processor may stop for ever if a file changes during a long wait.
        if first && (self.mode == BakeMode::Blocking || !can_swap) {
            let Some(levels) = self.wait_for(&request).await else { return self.meanwhile(path, &input) };
            if missing.is_empty() {
                self.settle(&request);
            }
            return levels;
        }
        // Levels that somebody has baked only wait for their textures.
        let found = request.cached_with_images().map(|result| result.combined.into());
        let meanwhile = found.unwrap_or_else(|| self.meanwhile(path, &input));
        if can_swap {
            self.queue.push(Job::swapped_in(request, blake3::hash(&meanwhile)));
        }
        meanwhile
    }

    /// Notes that a model has its levels, for the next start.
    pub(super) fn settle(&self, BakeRequest { path, key, .. }: &BakeRequest) {
        let noted = self.journal.end(path).and_then(|()| self.journal.set_good(path, &key.hex()));
        if let Err(error) = noted {
            warn!("{path}: {error}");
        }
    }

    /// Sends an event to the game.
    pub(super) fn tell(&self, event: Event) {
        // The channel is closed when the game has ended.
        let _ = self.events.try_send(event);
    }

    /// Reports a failure. `key` is the key of the desired levels, if the settings of the model give one.
    pub(super) fn fail(&self, path: &AssetPath<'static>, key: Option<Key>, error: String) {
        error!("{error}");
        self.tell(Event::Failed(key, BakeFailed { path: path.clone(), error }));
    }

    fn request(&self, path: &AssetPath<'static>, input: &Input) -> Result<BakeRequest, Error> {
        let bytes = input.project.as_ref().map_err(|e| Error::Settings(format!("{}: {e}", ProjectFile::PATH)))?;
        let project = self.project.parse(bytes)?;
        let mut layers = project.layers(&slashed(path.path()), self.project.profile.as_deref())?;
        if let Some(text) = &input.meta {
            let file = format!("{path}.meta");
            let overrides = parse_meta(text, &file)?;
            layers.extend(overrides.map(|overrides| Layer { origin: Origin::Meta { file }, overrides }));
        }
        let mut settings = resolve(layers)?.settings;
        settings.texture_compression = settings.texture_compression.in_game();
        let bake = CachedBake::new(input.files.source(), &settings, Parts::Combined, None)?;
        let (key, image_key) = (bake.key(), bake.image_key());
        Ok(BakeRequest { path: path.clone(), settings, key, image_key, cache: self.cache(&project) })
    }

    fn cache(&self, project: &ProjectFile) -> Option<Arc<Cache>> {
        let settings = &project.project.cache;
        let mut caches = self.caches.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = caches.get(settings) {
            return Some(known.clone());
        }
        let explicit = CachePlace { dir: self.cache_dir.as_deref(), shared: None };
        let warn = |outside: OutsideProject| warn!("{outside}");
        let cache = Arc::new(open_cache(explicit, settings, &self.project.base, warn)?);
        caches.insert(settings.clone(), cache.clone());
        Some(cache)
    }

    /// The levels, once they are baked. `None` if the bake fails or is cancelled.
    async fn wait_for(&self, request: &BakeRequest) -> Option<Bytes> {
        let (job, answer) = Job::awaited(request.clone());
        self.queue.push(job);
        answer.recv().await.ok()
    }

    /// The processed file of a model whose settings have an error.
    fn without_levels(&self, path: &AssetPath<'static>, input: &Input, error: &Error) -> Bytes {
        self.queue.forget(path);
        // The next start processes the model again: the error may have been corrected meanwhile.
        self.note_pending(path);
        self.fail(path, None, error.to_string());
        self.meanwhile(path, input)
    }

    fn note_pending(&self, path: &AssetPath<'static>) {
        if let Err(error) = self.journal.begin(path) {
            warn!("{path}: if the game ends before the bake, save the model again: {error}");
        }
    }

    /// The file that a game gets until the levels are there: the model itself. If Bevy cannot load it, the last levels, or
    /// the model decoded.
    fn meanwhile(&self, path: &AssetPath<'static>, input: &Input) -> Bytes {
        let source = input.files.bytes();
        if gltf::Gltf::from_slice(source).is_ok_and(|file| file.textures().all(|texture| is_loadable(&texture))) {
            return source.clone();
        }
        self.last_good(path, input).or_else(|| self.decoded(path, input)).unwrap_or_else(|| source.clone())
    }

    /// A model as it is, in one file, without compression of its geometry and textures. `None` if it cannot be read, or may
    /// not be read here: like a bake, it may end the game.
    fn decoded(&self, path: &AssetPath<'static>, input: &Input) -> Option<Bytes> {
        if self.isolate {
            return None;
        }
        let (source, settings) = (input.files.source(), BakeSettings { enabled: false, ..BakeSettings::default() });
        let key = CachedBake::new(source, &settings, Parts::Combined, None).ok()?.key();
        self.attempts.begin(&path.to_string(), key).ok()?;
        let context = Context { memory: Some(self.memory), ..Context::default() };
        let baked = simpliguard::bake(&source, &settings, &context);
        self.attempts.end(key);
        Some(baked.ok()?.glb.into())
    }

    fn last_good(&self, path: &AssetPath<'static>, input: &Input) -> Option<Bytes> {
        let project = self.project.parse(input.project.as_ref().ok()?).ok()?;
        let key = Key::from_hex(&self.journal.good(path)?)?;
        let warn = |notice| warn!("{path}: {notice}");
        let result = look_up(&*self.cache(&project)?, &key, Parts::Combined, warn)?;
        info!("{path}: keeps its last levels");
        Some(result.combined.into())
    }
}

/// False for a WebP image, unless the game has Bevy's feature for it.
fn is_loadable(texture: &gltf::Texture<'_>) -> bool {
    let is_webp = match texture.source().source() {
        gltf::image::Source::View { mime_type, .. } => mime_type == WEBP,
        gltf::image::Source::Uri { uri, mime_type } => mime_type == Some(WEBP) || uri.ends_with(".webp"),
    };
    !is_webp || ImageFormat::from_mime_type(WEBP).is_some()
}

/// A path with `/` between its parts.
fn slashed(path: &Path) -> String {
    let text = path.to_string_lossy();
    if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() }
}
