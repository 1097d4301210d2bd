//! `simpliguard bake`: bakes one model after another, each on all threads.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Cursor};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Instant;

use image::{ImageFormat, RgbImage};
use rayon::{ThreadPool, ThreadPoolBuilder};
use simpliguard::data::{Level, Model};
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::settings::BakeSettings;
use simpliguard::{Context, Error, NoResources, Source, StageId};
use simpliguard_bake::{
    BakeResult, CachePlace, CachedBake, Host, Notice, Outcome, OutsideProject, Parts, SHARED_ENV_VAR, default_memory,
};
use simpliguard_cache::{
    Cache, Counters, Durability, StorageError, can_write_in, read_bounded, remove_stale_temporaries, write_atomic,
};
use simpliguard_eval::{TurntableError, contact_sheet, turntable};

use crate::Exit;
use crate::args::BakeArgs;
use crate::console::{self, AssetProgress};
use crate::deadline::{self, LastStage};
use crate::error::UsageError;
use crate::interrupt::Interrupt;
use crate::plan::{Job, plan};
use crate::project::ProjectCache;
use crate::source::SourceFile;
use crate::summary::{self, JobReport, Written};

/// The note of a result whose model is not there any more.
const GONE: &str = "the model was deleted or renamed meanwhile; the result is that of the file as it was read";

/// Bakes all models.
pub(crate) fn run(args: &BakeArgs) -> Result<Exit, UsageError> {
    let result = bake_all(args);
    if let (Err(error), true) = (&result, args.json) {
        summary::print_refusal(error)?;
    }
    result
}

fn bake_all(args: &BakeArgs) -> Result<Exit, UsageError> {
    let jobs = plan(args)?;
    let runner = Runner::new(args)?;
    runner.probe(&jobs)?;
    let bake = |(number, job)| runner.bake(job, AssetProgress::new(number + 1, jobs.len(), &job.name));
    let reports: Vec<JobReport> = jobs.iter().enumerate().map(bake).collect();
    let counters = runner.finish();
    summary::print(&reports, &counters, args.json, args.report.as_deref())?;
    Ok(summary::exit(&reports))
}

/// The state that all bakes of one run share.
struct Runner<'a> {
    args: &'a BakeArgs,
    interrupt: Interrupt,
    /// Bytes that the bake of one model may take.
    memory: u64,
    /// `None` for the global pool with all cores.
    pool: Option<ThreadPool>,
    /// The caches of the projects so far. A shared cache that hangs costs one of them one wait, not each model.
    caches: RefCell<BTreeMap<ProjectCache, Option<Rc<Cache>>>>,
    /// Output folders without stale temporary files.
    swept: RefCell<BTreeSet<PathBuf>>,
    /// Folders outside of their projects that a warning was printed for. A project has many models, but one cache.
    outside: RefCell<BTreeSet<PathBuf>>,
}

/// The command around the bake of one model.
struct JobHost<'a> {
    runner: &'a Runner<'a>,
    job: &'a Job,
    progress: &'a AssetProgress,
}

impl Host for JobHost<'_> {
    /// Checks the output folder, because a bake takes too long to find out afterwards.
    fn begin(&self) -> Result<(), Error> {
        self.runner.can_write(self.job)
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
            self.progress.note(&notice.to_string());
        }
    }
}

impl<'a> Runner<'a> {
    fn new(args: &'a BakeArgs) -> Result<Self, UsageError> {
        let build = |n: NonZeroUsize| ThreadPoolBuilder::new().num_threads(n.get()).build();
        let pool = args.threads.map(build).transpose();
        let pool = pool.map_err(|e| UsageError(format!("--threads: cannot start the threads: {e}")))?;
        Ok(Self {
            args,
            interrupt: Interrupt::install(),
            memory: args.memory.map_or_else(default_memory, |size| size.as_u64()),
            pool,
            caches: RefCell::default(),
            swept: RefCell::default(),
            outside: RefCell::default(),
        })
    }

    /// Asks the shared caches that the command line or the environment names whether they can be used. One that never can is a
    /// mistake, which is better found before an evening of bakes than after it.
    fn probe(&self, jobs: &[Job]) -> Result<(), UsageError> {
        if self.args.shared_cache.is_none() && std::env::var_os(SHARED_ENV_VAR).is_none_or(|address| address.is_empty())
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
    fn finish(&self) -> Counters {
        let mut counters = Counters::default();
        for cache in self.caches.borrow().values().flatten() {
            let (counts, errors) = cache.finish();
            counters += counts;
            errors.iter().for_each(|error| console::warning(&error.to_string()));
        }
        counters
    }

    fn bake(&self, job: &Job, progress: AssetProgress) -> JobReport {
        let start = Instant::now();
        let result = job.settings.as_ref().map_err(ToString::to_string).and_then(|settings| {
            let file = SourceFile::read(&job.input, &job.name, job.cache.project()).map_err(|e| e.to_string())?;
            let mut outcome = self.find_or_bake(job, &file, settings, &progress).map_err(|e| e.to_string())?;
            let written = self.write(job, &file, &outcome.result).map_err(|e| e.to_string())?;
            if !job.input.exists() {
                outcome.result.report.notes.push(GONE.to_owned());
            }
            let missed = self.args.gate.check(&outcome.result.report.levels, settings.warn_below);
            Ok((outcome, written, missed))
        });
        let report = match result {
            Ok((outcome, written, missed)) => JobReport::done(job, outcome, written, missed, start.elapsed()),
            Err(error) => JobReport::failed(job, error, start.elapsed()),
        };
        progress.finish(&report.line());
        report
    }

    fn find_or_bake(
        &self,
        job: &Job,
        file: &SourceFile,
        settings: &BakeSettings,
        progress: &AssetProgress,
    ) -> Result<Outcome, Error> {
        let cache = self.cache(job);
        let draw = |model: &Model, levels: &[Level]| png(&model.name, &contact_sheet(model, levels));
        let parts = if self.args.sheet { Parts::Sheet(&draw) } else { Parts::Levels };
        let bake = CachedBake::new(file.source(), settings, parts, cache.as_deref())?;
        let stage = LastStage::new(progress);
        let context = Context { progress: Some(&stage), memory: Some(self.memory), ..Context::default() };
        let run = || bake.run(&context, &JobHost { runner: self, job, progress });
        deadline::within(self.args.timeout, (&job.name, &stage), &context.cancellation, run)
    }

    fn cache(&self, job: &Job) -> Option<Rc<Cache>> {
        if self.args.no_cache {
            return None;
        }
        let explicit = CachePlace { dir: self.args.cache_dir.as_deref(), shared: self.args.shared_cache.as_deref() };
        let warn = |outside: OutsideProject| {
            if self.outside.borrow_mut().insert(outside.folder.clone()) {
                console::warning(&outside.to_string());
            }
        };
        let mut caches = self.caches.borrow_mut();
        let open = || job.cache.open(explicit, warn).map(|cache| Rc::new(cache.with_background_uploads()));
        caches.entry(job.cache.clone()).or_insert_with(open).clone()
    }

    fn in_pool<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Writes the files that were asked for.
    fn write(&self, job: &Job, file: &SourceFile, result: &BakeResult) -> Result<Written, Error> {
        let mut written = Written::default();
        self.write_file(job, &job.combined_path(), &result.combined)?;
        if self.args.split_levels {
            for (budget, glb) in &result.levels {
                let path = job.level_path(*budget);
                self.write_file(job, &path, glb)?;
                written.levels.push(path);
            }
        }
        if let (true, Some(png)) = (self.args.sheet, &result.sheet) {
            let path = job.sheet_path();
            self.write_file(job, &path, png)?;
            written.sheet = Some(path);
        }
        if self.args.turntable && !result.levels.is_empty() {
            let path = job.turntable_path();
            let memory = self.memory;
            let png = self.in_pool(|| draw_turntable(job, file, &result.levels, memory))?;
            self.write_file(job, &path, &png)?;
            written.turntable = Some(path);
        }
        Ok(written)
    }

    fn write_file(&self, job: &Job, path: &Path, bytes: &[u8]) -> Result<(), Error> {
        // An unchanged file is not written, so that programs that watch it see no change.
        if read_bounded(path, bytes.len() as u64).is_ok_and(|there| there == bytes) {
            return Ok(());
        }
        self.sweep(path);
        let _hold = self.interrupt.hold();
        write_atomic(path, bytes, Durability::Process).map_err(|e| unwritable(job, path, &e))
    }

    /// Removes what killed runs have left in the folder of an output.
    fn sweep(&self, output: &Path) {
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if self.swept.borrow_mut().insert(folder.to_owned()) {
            remove_stale_temporaries(folder);
        }
    }

    /// Checks that files can be created in the nearest existing folder above the result. Leaves nothing behind.
    fn can_write(&self, job: &Job) -> Result<(), Error> {
        let path = job.combined_path();
        let there = path.ancestors().skip(1).find(|folder| folder.exists());
        let folder = there.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let _hold = self.interrupt.hold();
        can_write_in(folder).map_err(|e| unwritable(job, &path, &e))
    }
}

/// Draws a turntable from the files of the levels, so that a result from the cache suffices.
fn draw_turntable(job: &Job, file: &SourceFile, levels: &[(u32, Vec<u8>)], memory: u64) -> Result<Vec<u8>, Error> {
    let limits = ImportLimits { memory, ..ImportLimits::default() };
    let model = import(&file.source(), &limits)?;
    let level =
        |(_, glb): &(u32, Vec<u8>)| import(&Source { name: &job.name, bytes: glb, resources: &NoResources }, &limits);
    let levels: Vec<Model> = levels.iter().rev().map(level).collect::<Result<_, _>>()?;
    let invalid = |e: TurntableError| Error::invalid(&job.name, StageId::Export, format!("{e}"), "omit --turntable");
    turntable(&model, &levels).map_err(invalid)
}

fn unwritable(job: &Job, path: &Path, error: &io::Error) -> Error {
    let found = format!("cannot write {}: {error}", path.display());
    Error::invalid(&job.name, StageId::Export, found, "check the folder and the space on its disk")
}

fn png(asset: &str, image: &RgbImage) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).map_err(|e| {
        Error::invalid(asset, StageId::Export, format!("the contact sheet cannot be encoded: {e}"), "omit --sheet")
    })?;
    Ok(bytes)
}
