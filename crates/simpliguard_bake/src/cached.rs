//! The cached bake: key, look-up, single flight, bake, store.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use simpliguard::gltf::BLOCKS_VERSION;
use simpliguard::settings::{BakeSettings, Scope, TextureCompression};
use simpliguard::{Context, Error, Key, KeyBuilder, ProgressSink, SceneBake, Source, StageStore, bake_key};
use simpliguard_cache::{Cache, Flight, Lookup, SingleFlight};

use crate::device::{Processor, find_device};
use crate::host::{Host, Notice};
use crate::isolation::Isolation;
use crate::object_host::ObjectHost;
use crate::result::{BakeResult, Parts, catch_panics};
use crate::stage_objects::StageObjects;

/// A bake whose result may be in a cache.
pub struct CachedBake<'a> {
    source: Source<'a>,
    settings: &'a BakeSettings,
    parts: Parts<'a>,
    cache: Option<&'a Cache>,
    isolation: Option<&'a Isolation>,
    processor: Processor,
    key: Key,
    /// The key of the result whose textures are images. The other one is made from it.
    image_key: Key,
}

/// A result and its origin.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The key of the result.
    pub key: Key,
    /// The result, with the parts that were asked for.
    pub result: BakeResult,
    /// True if the cache had the result, perhaps because another program has just made it.
    pub is_cached: bool,
}

impl<'a> CachedBake<'a> {
    /// A bake of a source with settings. Reads all files of the source to compute the key. Without a cache, nothing is
    /// looked up or stored.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the source is no glTF.
    pub fn new(
        source: Source<'a>,
        settings: &'a BakeSettings,
        parts: Parts<'a>,
        cache: Option<&'a Cache>,
    ) -> Result<Self, Error> {
        let image_key = bake_key(&source, settings)?;
        let key = match settings.texture_compression {
            TextureCompression::Auto | TextureCompression::Off => image_key,
            TextureCompression::Bc => {
                KeyBuilder::new("textures in blocks").stage("BC7", BLOCKS_VERSION).key(&image_key).finish()
            }
        };
        Ok(Self { key, image_key, source, settings, parts, cache, isolation: None, processor: Processor::default() })
    }

    /// The key of the result whose textures are images. With `texture_compression: Bc`, [`Self::key`] is another one: its
    /// result is made from this one in little time.
    pub fn image_key(&self) -> Key {
        self.image_key
    }

    /// The bake of the result whose textures are images.
    fn with_images(&self) -> Self {
        Self { key: self.image_key, ..*self }
    }

    /// Bakes in a process of its own, if there is to be one.
    #[must_use]
    pub fn isolated(self, isolation: Option<&'a Isolation>) -> Self {
        Self { isolation, ..self }
    }

    /// Refines levels on this processor. Without it, on the CPU.
    #[must_use]
    pub fn on(self, processor: impl Into<Processor>) -> Self {
        Self { processor: processor.into(), ..self }
    }

    /// The key of the result: it stands for all bytes of the source, the settings and the version of the pipeline.
    pub fn key(&self) -> Key {
        self.key
    }

    /// Finds the result in the cache, or bakes and stores it. If another thread or process bakes the same, waits for
    /// it. `context` has no stage store of its own: the stages use the cache. With `scope: Objects`, each object is a cached
    /// bake of its own.
    ///
    /// The wait blocks the thread. Never call this on a thread that [`Host::compute`] needs.
    ///
    /// # Errors
    /// Those of the pipeline and of [`Host::begin`]; [`Error::Cancelled`] if the wait or the bake is cancelled.
    pub fn run(&self, context: &Context<'_>, host: &impl Host) -> Result<Outcome, Error> {
        if self.key != self.image_key {
            return self.find_or_make(context, host, |context| {
                let Outcome { result, .. } = self.with_images().run_with_images(context, host)?;
                host.compute(|| result.in_blocks(self.source.name, context))
            });
        }
        self.run_with_images(context, host)
    }

    /// As [`Self::run`], for a bake [with images](Self::with_images).
    fn run_with_images(&self, context: &Context<'_>, host: &impl Host) -> Result<Outcome, Error> {
        self.find_or_make(context, host, |context| {
            host.begin()?;
            let Some(isolation) = self.isolation else { return self.make(context, host) };
            let terms = (self.parts, self.processor);
            match isolation.bake((&self.source, self.settings, self.cache), terms, (context, host))? {
                Some(result) => Ok(result),
                None => self.make(context, host),
            }
        })
    }

    /// Bakes in this process, whether the cache has the result or not.
    pub(crate) fn make(&self, context: &Context<'_>, host: &impl Host) -> Result<BakeResult, Error> {
        match self.settings.scope {
            Scope::Scene => self.bake(context, host),
            Scope::Objects => self.bake_objects(context, host),
        }
    }

    fn find_or_make(
        &self,
        context: &Context<'_>,
        host: &impl Host,
        make: impl FnOnce(&Context<'_>) -> Result<BakeResult, Error>,
    ) -> Result<Outcome, Error> {
        let outcome = |result, is_cached| Outcome { key: self.key, result, is_cached };
        let Some(cache) = self.cache else {
            return Ok(outcome(make(context)?, false));
        };
        let flight = Flight {
            key: &self.key,
            is_cancelled: &|| context.cancellation.is_cancelled(),
            notify: &|notice| host.notify(notice.into()),
            check: self.parts.check(),
        };
        let find = || look_up(cache, &self.key, self.parts, |notice| host.notify(notice));
        let take = |entry| BakeResult::from_entry(entry).filter(|result| self.parts.are_in(result));
        let make = |has_arrived: &Arc<AtomicBool>| {
            let cancellation = context.cancellation.or(has_arrived.clone());
            let result = make(&Context { cancellation, ..context.clone() });
            result.inspect(|result| self.store(cache, result, host))
        };
        match cache.single_flight(&flight, find, take, make)? {
            SingleFlight::Found(result) => Ok(outcome(result, true)),
            SingleFlight::Made(result) => Ok(outcome(result, false)),
            SingleFlight::Cancelled => Err(Error::Cancelled { asset: self.source.name.to_owned() }),
        }
    }

    fn bake(&self, context: &Context<'_>, host: &impl Host) -> Result<BakeResult, Error> {
        let stages = self.cache.map(StageObjects);
        let stages = stages.as_ref().map(|stages| stages as &dyn StageStore);
        let device = find_device(self.processor, |notice| host.notify(notice));
        let context = Context { stages, device, ..context.clone() };
        host.compute(|| BakeResult::compute(&self.source, self.settings, &context, self.parts))
    }

    /// Bakes the objects of a scene that no cache has, one after another.
    fn bake_objects(&self, context: &Context<'_>, host: &impl Host) -> Result<BakeResult, Error> {
        let asset = self.source.name;
        let open = || SceneBake::open(&self.source, self.settings, context);
        let Some(mut scene) = host.compute(|| catch_panics(asset, open))? else {
            return self.bake(context, host);
        };
        while let Some(object) = host.compute(|| catch_panics(asset, || scene.next_object(context)))? {
            context.check(asset)?;
            let progress = context.progress.map(|sink| scene.progress(&object, sink));
            let progress = progress.as_ref().map(|progress| progress as &dyn ProgressSink);
            let own = Context { progress, preview: None, ..context.clone() };
            let outcome = CachedBake::new(object.source(&self.source), &object.settings, Parts::Combined, self.cache)
                .map(|bake| bake.on(self.processor).with_images())
                .and_then(|bake| bake.find_or_make(&own, &ObjectHost(host), |own| bake.bake(own, host)));
            let is_object = |_: &&Outcome| object.is_object();
            outcome.iter().filter(is_object).for_each(|outcome| host.object(&object.name, outcome.is_cached));
            let result = outcome.map(|Outcome { result, .. }| (result.combined, result.report));
            host.compute(|| catch_panics(asset, || scene.take(&object, result)))?;
        }
        let baked = host.compute(|| catch_panics(asset, || scene.finish(context)))?;
        Ok(BakeResult { combined: baked.glb, levels: Vec::new(), sheet: None, report: baked.report })
    }

    /// A storage error never fails a bake.
    fn store(&self, cache: &Cache, result: &BakeResult, host: &impl Host) {
        let mut stored = Ok(());
        host.store(|| {
            let entry = result.to_entry().map_err(|e| Notice::NotKept(e.into()));
            stored = entry.and_then(|entry| cache.put(&self.key, &entry).map_err(|e| Notice::NotKept(e.into())));
        });
        if let Err(notice) = stored {
            host.notify(notice);
        }
    }
}

/// The result of a key if the local cache has all `parts` of it. The shared tier is not asked.
pub fn look_up(cache: &Cache, key: &Key, parts: Parts<'_>, notify: impl FnOnce(Notice)) -> Option<BakeResult> {
    match cache.get_objects(key, |object| parts.include(object)) {
        Lookup::Hit(entry) => BakeResult::from_entry(entry).filter(|result| parts.are_in(result)),
        Lookup::Miss => None,
        Lookup::Damaged(error) => {
            notify(error.into());
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};

    use simpliguard::{Cancellation, NoResources, Status};
    use simpliguard_cache::Entry;

    use super::*;

    /// A glTF without triangles, which passes through.
    const EMPTY: &[u8] = br#"{"asset":{"version":"2.0"}}"#;

    #[derive(Default)]
    struct Recorder {
        begun: Cell<u32>,
        notices: RefCell<Vec<String>>,
        refusal: Option<&'static str>,
    }

    impl Host for Recorder {
        fn begin(&self) -> Result<(), Error> {
            self.begun.set(self.begun.get() + 1);
            self.refusal.map_or(Ok(()), |why| Err(Error::Settings(why.into())))
        }

        fn notify(&self, notice: Notice) {
            assert!(notice.is_warning());
            self.notices.borrow_mut().push(notice.to_string());
        }
    }

    fn bake<'a>(settings: &'a BakeSettings, cache: Option<&'a Cache>) -> CachedBake<'a> {
        let source = Source { name: "empty.gltf", bytes: EMPTY, resources: &NoResources };
        CachedBake::new(source, settings, Parts::Combined, cache).expect("a glTF")
    }

    #[test]
    fn a_result_is_made_once_and_found_again() {
        let (dir, settings, host) =
            (tempfile::tempdir().expect("tempdir"), BakeSettings::default(), Recorder::default());
        let cache = Cache::new(dir.path());
        let bake = bake(&settings, Some(&cache));
        let first = bake.run(&Context::default(), &host).expect("bakes");
        let second = bake.run(&Context::default(), &host).expect("is found");
        assert_eq!((first.is_cached, second.is_cached, host.begun.get()), (false, true, 1));
        assert_eq!(
            (first.result.report.status, &first.result.combined),
            (Status::PassThrough, &second.result.combined)
        );
        assert!(host.notices.into_inner().is_empty());
    }

    #[test]
    fn textures_in_blocks_have_a_key_of_their_own_and_share_the_bake() {
        let (dir, host) = (tempfile::tempdir().expect("tempdir"), Recorder::default());
        let cache = Cache::new(dir.path());
        let with = |texture_compression| BakeSettings { texture_compression, ..BakeSettings::default() };
        let run = |settings: &BakeSettings| {
            let outcome = bake(settings, Some(&cache)).run(&Context::default(), &host).expect("bakes");
            (outcome.key, outcome.is_cached)
        };
        let [auto, off, bc] = [TextureCompression::Auto, TextureCompression::Off, TextureCompression::Bc].map(with);
        let (images, _) = run(&auto);
        assert_eq!(run(&off), (images, true));
        let (blocks, is_cached) = run(&bc);
        assert!(blocks != images && !is_cached);
        assert_eq!(run(&bc), (blocks, true));
        assert_eq!(host.begun.get(), 1, "one bake for both");
    }

    #[test]
    fn a_host_may_refuse_and_nothing_is_kept() {
        let (dir, settings) = (tempfile::tempdir().expect("tempdir"), BakeSettings::default());
        let cache = Cache::new(dir.path());
        let bake = bake(&settings, Some(&cache));
        let host = Recorder { refusal: Some("no"), ..Recorder::default() };
        assert!(matches!(bake.run(&Context::default(), &host), Err(Error::Settings(why)) if why == "no"));
        assert!(look_up(&cache, &bake.key(), Parts::Combined, |_| {}).is_none());
    }

    #[test]
    fn storage_that_fails_is_a_notice() {
        let (dir, settings, host) =
            (tempfile::tempdir().expect("tempdir"), BakeSettings::default(), Recorder::default());
        std::fs::write(dir.path().join("file"), "").expect("writes");
        let cache = Cache::new(dir.path().join("file"));
        let outcome = bake(&settings, Some(&cache)).run(&Context::default(), &host).expect("bakes");
        let notices = host.notices.into_inner();
        assert!(
            !outcome.is_cached && notices.iter().any(|n| n.starts_with("the result is not kept: cache: ")),
            "{notices:?}"
        );
        let host = Recorder::default();
        assert!(!bake(&settings, None).run(&Context::default(), &host).expect("bakes").is_cached);
    }

    #[test]
    fn a_forged_result_of_a_shared_cache_is_baked_instead() {
        let (dir, settings) = (tempfile::tempdir().expect("tempdir"), BakeSettings::default());
        let server = Cache::new(dir.path().join("server"));
        let key = bake(&settings, None).key();
        let forged =
            [("combined.glb".to_owned(), b"MZ\x90\0 a program".to_vec()), ("report.json".to_owned(), b"{}".to_vec())];
        server.put(&key, &Entry { objects: forged.to_vec() }).expect("stores");
        let cache = Cache::new(dir.path().join("cache")).with_shared_tier("server", dir.path(), false);
        let host = Recorder::default();
        let outcome = bake(&settings, Some(&cache)).run(&Context::default(), &host).expect("bakes");
        assert!(!outcome.is_cached && outcome.result.combined.starts_with(b"glTF"));
        let notices = host.notices.into_inner();
        assert!(
            notices.len() == 1 && notices[0].contains("is not the result of a bake: combined.glb: "),
            "{notices:?}"
        );
    }

    #[test]
    fn a_shared_result_is_used_where_none_can_be_kept() {
        let (dir, settings) = (tempfile::tempdir().expect("tempdir"), BakeSettings::default());
        std::fs::create_dir(dir.path().join("server")).expect("makes");
        std::fs::write(dir.path().join("file"), "").expect("writes");
        let run = |folder: &str| {
            let cache = Cache::new(dir.path().join(folder)).with_shared_tier("server", dir.path(), false);
            let host = Recorder::default();
            bake(&settings, Some(&cache)).run(&Context::default(), &host).expect("bakes").is_cached
        };
        assert_eq!(["first", "file", "second"].map(run), [false, true, true]);
    }

    #[test]
    fn a_cancelled_bake_has_no_result() {
        let settings = BakeSettings::default();
        let context = Context { cancellation: Cancellation::default(), ..Context::default() };
        context.cancellation.cancel();
        let stopped = bake(&settings, None).run(&context, &Recorder::default());
        assert!(matches!(stopped, Err(Error::Cancelled { .. })), "{stopped:?}");
    }
}
