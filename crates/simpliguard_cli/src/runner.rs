//! The runner: finds the results of models in the cache or bakes them, one after another, each on all threads.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::rc::Rc;
use std::thread::available_parallelism;

use rayon::{ThreadPool, ThreadPoolBuilder};
use simpliguard::settings::BakeSettings;
use simpliguard::{Context, Error};
use simpliguard_bake::{
    CachePlace, CachedBake, Host, Isolation, Notice, Outcome, OutsideProject, Parts, SHARED_ENV_VAR, default_memory,
};
use simpliguard_cache::{Cache, Counters, StorageError};

use crate::args::ModelArgs;
use crate::console::{self, AssetProgress};
use crate::deadline::{self, LastStage};
use crate::error::UsageError;
use crate::interrupt::Interrupt;
use crate::plan::Job;
use crate::project::ProjectCache;
use crate::source::SourceFile;

/// The state that all bakes of one run share.
pub(crate) struct Runner<'a> {
    models: &'a ModelArgs,
    pub(crate) interrupt: Interrupt,
    /// Bytes that the bake of one model may take.
    pub(crate) memory: u64,
    /// `None` for the global pool with all cores.
    pool: Option<ThreadPool>,
    isolation: Option<Isolation>,
    /// The caches of the projects so far. A shared cache that hangs costs one of them one wait, not each model.
    caches: RefCell<BTreeMap<ProjectCache, Option<Rc<Cache>>>>,
    /// Folders outside of their projects that a warning was printed for. A project has many models, but one cache.
    outside: RefCell<BTreeSet<PathBuf>>,
}

/// A model that has been read, and what its bake needs.
pub(crate) struct Request<'a> {
    pub(crate) job: &'a Job,
    pub(crate) file: &'a SourceFile,
    pub(crate) settings: &'a BakeSettings,
    pub(crate) parts: Parts<'a>,
    pub(crate) progress: &'a AssetProgress,
    /// Called before a bake begins. An error ends it.
    pub(crate) begin: &'a dyn Fn() -> Result<(), Error>,
}

/// The command around the bake of one model.
struct JobHost<'a> {
    runner: &'a Runner<'a>,
    request: &'a Request<'a>,
    /// Objects of a scene that were baked, and those that the cache had.
    objects: Cell<[u32; 2]>,
}

impl Host for JobHost<'_> {
    fn begin(&self) -> Result<(), Error> {
        (self.request.begin)()
    }

    fn compute<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.runner.in_pool(work)
    }

    fn store(&self, work: impl FnOnce()) {
        let _hold = self.runner.interrupt.hold();
        work();
    }

    fn notify(&self, notice: Notice) {
        if notice.is_warning() {
            console::warning(&notice.to_string());
        } else {
            self.request.progress.note(&notice.to_string());
        }
    }

    fn object(&self, _: &str, is_cached: bool) {
        let mut objects = self.objects.get();
        objects[usize::from(is_cached)] += 1;
        self.objects.set(objects);
    }
}

impl<'a> Runner<'a> {
    pub(crate) fn new(models: &'a ModelArgs) -> Result<Self, UsageError> {
        let build = |n: NonZeroUsize| ThreadPoolBuilder::new().num_threads(n.get()).build();
        let pool = models.threads.map(build).transpose();
        let pool = pool.map_err(|e| UsageError(format!("--threads: cannot start the threads: {e}")))?;
        Ok(Self {
            models,
            interrupt: Interrupt::install(),
            memory: models.memory.map_or_else(default_memory, |size| size.as_u64()),
            pool,
            isolation: models.isolate.then(|| isolation(models)).transpose()?,
            caches: RefCell::default(),
            outside: RefCell::default(),
        })
    }

    /// Asks the shared caches that the command line or the environment names whether they can be used. One that never can is a
    /// mistake, which is better found before an evening of bakes than after it.
    pub(crate) fn probe(&self, jobs: &[Job]) -> Result<(), UsageError> {
        if self.models.shared_cache.is_none()
            && std::env::var_os(SHARED_ENV_VAR).is_none_or(|address| address.is_empty())
        {
            return Ok(());
        }
        let mut asked = BTreeSet::new();
        for job in jobs.iter().filter(|job| asked.insert(job.cache.clone())) {
            match self.cache(job).map_or(Ok(()), |cache| cache.probe()) {
                Err(error @ StorageError::Misconfigured { .. }) => return Err(UsageError(error.to_string())),
                Err(error) => console::warning(&error.to_string()),
                Ok(()) => {}
            }
        }
        Ok(())
    }

    /// Waits for the uploads. Returns what the tiers have counted.
    pub(crate) fn finish(&self) -> Counters {
        let mut counters = Counters::default();
        for cache in self.caches.borrow().values().flatten() {
            let (counts, errors) = cache.finish();
            counters += counts;
            errors.iter().for_each(|error| console::warning(&error.to_string()));
        }
        counters
    }

    /// The result of a model: from the cache, or baked and stored.
    ///
    /// # Errors
    /// Those of the pipeline and of [`Request::begin`].
    pub(crate) fn find_or_bake(&self, request: &Request<'_>) -> Result<Outcome, Error> {
        let Request { job, file, settings, parts, progress, .. } = *request;
        let cache = self.cache(job);
        let bake = CachedBake::new(file.source(), settings, parts, cache.as_deref())?;
        let bake = bake.isolated(self.isolation.as_ref()).on(job.backend);
        let stage = LastStage::new(progress);
        let context = Context { progress: Some(&stage), memory: Some(self.memory), ..Context::default() };
        let run = || {
            let host = JobHost { runner: self, request, objects: Cell::default() };
            let outcome = bake.run(&context, &host);
            let [baked, found] = host.objects.get();
            if baked + found > 0 {
                progress.note(&format!("kinds of objects: {baked} baked, {found} from the cache"));
            }
            outcome
        };
        deadline::within(self.models.timeout, (&job.name, &stage), &context.cancellation, run)
    }

    fn cache(&self, job: &Job) -> Option<Rc<Cache>> {
        if self.models.no_cache {
            return None;
        }
        let explicit =
            CachePlace { dir: self.models.cache_dir.as_deref(), shared: self.models.shared_cache.as_deref() };
        let warn = |outside: OutsideProject| {
            if self.outside.borrow_mut().insert(outside.folder.clone()) {
                console::warning(&outside.to_string());
            }
        };
        let mut caches = self.caches.borrow_mut();
        let open = || job.cache.open(explicit, warn).map(|cache| Rc::new(cache.with_background_uploads()));
        caches.entry(job.cache.clone()).or_insert_with(open).clone()
    }

    /// Runs work on the threads of this run.
    pub(crate) fn in_pool<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}

/// Bakes in processes of this command.
fn isolation(models: &ModelArgs) -> Result<Isolation, UsageError> {
    let threads = models.threads.or_else(|| available_parallelism().ok()).map_or(1, NonZeroUsize::get);
    Isolation::new(threads).map_err(|e| UsageError(format!("--isolate: {e}")))
}
