//! `simpliguard bake`: one model after another, each on all threads.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};
use std::time::Instant;

use image::{ImageFormat, RgbImage};
use rayon::{ThreadPool, ThreadPoolBuilder};
use simpliguard::data::{Level, Model};
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::settings::BakeSettings;
use simpliguard::{Cancellation, Context, Error, NoResources, Source, StageId, StageStore};
use simpliguard_cache::{
    BakeResult, Cache, Draw, Durability, Explicit, Key, Lookup, Notice, Once, OutsideProject, bake_key, can_write_in,
    write_atomic,
};
use simpliguard_eval::{TurntableError, contact_sheet, turntable};

use crate::UsageError;
use crate::args::BakeArgs;
use crate::console::{self, AssetProgress};
use crate::interrupt::Interrupt;
use crate::plan::{Job, plan};
use crate::source::SourceFile;
use crate::summary::{self, Outcome, Written};

/// What computes a result; part of its record, not of its key.
const MADE_BY: &str = "cpu";

/// Bakes everything; whether all went well.
pub(crate) fn run(args: &BakeArgs) -> Result<bool, UsageError> {
    let result = bake_all(args);
    if let (Err(error), true) = (&result, args.json) {
        summary::print_refusal(error)?;
    }
    result
}

fn bake_all(args: &BakeArgs) -> Result<bool, UsageError> {
    args.backend.check()?;
    let jobs = plan(args)?;
    let runner = Runner::new(args)?;
    let bake = |(number, job)| runner.bake(job, AssetProgress::new(number + 1, jobs.len(), &job.name));
    let outcomes: Vec<Outcome> = jobs.iter().enumerate().map(bake).collect();
    summary::print(&outcomes, args.json)?;
    Ok(outcomes.iter().all(Outcome::succeeded))
}

/// What all bakes of one run share.
struct Runner<'a> {
    args: &'a BakeArgs,
    interrupt: Interrupt,
    /// `None` for the global pool with all cores.
    pool: Option<ThreadPool>,
    /// Folders that were told of: a project has many models, but one cache.
    outside: RefCell<BTreeSet<PathBuf>>,
}

impl<'a> Runner<'a> {
    fn new(args: &'a BakeArgs) -> Result<Self, UsageError> {
        let build = |n: std::num::NonZeroUsize| ThreadPoolBuilder::new().num_threads(n.get()).build();
        let pool = args.threads.map(build).transpose();
        let pool = pool.map_err(|e| UsageError(format!("--threads: cannot start the threads: {e}")))?;
        Ok(Self { args, interrupt: Interrupt::install(), pool, outside: RefCell::default() })
    }

    fn bake(&self, job: &Job, progress: AssetProgress) -> Outcome {
        let start = Instant::now();
        let result = job.settings.as_ref().map_err(ToString::to_string).and_then(|settings| {
            let (result, cached) = self.result(job, settings, &progress).map_err(|e| e.to_string())?;
            let written = self.write(job, &result).map_err(|e| e.to_string())?;
            Ok((result.report, cached, written))
        });
        let outcome = match result {
            Ok((report, cached, written)) => Outcome::done(job, report, cached, written, start.elapsed()),
            Err(error) => Outcome::failed(job, error, start.elapsed()),
        };
        progress.finish(&outcome.line());
        outcome
    }

    /// From the cache, or baked; and which of the two.
    fn result(
        &self,
        job: &Job,
        settings: &BakeSettings,
        progress: &AssetProgress,
    ) -> Result<(BakeResult, bool), Error> {
        let file = SourceFile::read(&job.input, &job.name)?;
        let source = file.source();
        let key = bake_key(&source, settings)?;
        let cache = self.cache(job);
        let bake = || {
            // A bake is too long to find out afterwards.
            self.can_write(job)?;
            self.compute(&source, settings, cache.as_ref(), progress)
        };
        let Some(cache) = &cache else { return Ok((bake()?, false)) };
        let once = cache.once(
            &key,
            &Cancellation::default(),
            |notice: Notice| match notice {
                Notice::Waits => progress.note(&notice.to_string()),
                Notice::Shared(error) => console::warning(&error.to_string()),
            },
            || self.look_up(cache, &key).filter(|result| self.suffices(result)),
            || bake().inspect(|result| self.store(cache, &key, result)),
        )?;
        match once {
            Once::Found(result) => Ok((result, true)),
            Once::Made(result) => Ok((result, false)),
            Once::Cancelled => Err(Error::Cancelled { asset: job.name.clone() }),
        }
    }

    fn cache(&self, job: &Job) -> Option<Cache> {
        let explicit = Explicit { dir: self.args.cache_dir.as_deref(), shared: self.args.shared_cache.as_deref() };
        let tell = |outside: OutsideProject| {
            if self.outside.borrow_mut().insert(outside.folder.clone()) {
                console::warning(&outside.to_string());
            }
        };
        if self.args.no_cache { None } else { job.cache.open(explicit, tell) }
    }

    fn look_up(&self, cache: &Cache, key: &Key) -> Option<BakeResult> {
        match cache.get(key) {
            Lookup::Hit(entry) => BakeResult::from_entry(entry),
            Lookup::Miss => None,
            Lookup::Damaged(error) => {
                console::warning(&error.to_string());
                None
            }
        }
    }

    /// A sheet needs the levels as they were in memory, so a result that was made without one is baked again.
    fn suffices(&self, result: &BakeResult) -> bool {
        !self.args.sheet || result.sheet.is_some() || result.levels.is_empty()
    }

    fn store(&self, cache: &Cache, key: &Key, result: &BakeResult) {
        let _hold = self.interrupt.hold();
        let stored = result.to_entry(MADE_BY).map_err(|e| e.to_string());
        if let Err(e) = stored.and_then(|entry| cache.put(key, &entry).map_err(|e| e.to_string())) {
            console::warning(&format!("the result is not kept: {e}"));
        }
    }

    fn compute(
        &self,
        source: &Source<'_>,
        settings: &BakeSettings,
        cache: Option<&Cache>,
        progress: &AssetProgress,
    ) -> Result<BakeResult, Error> {
        let stages = cache.map(|cache| cache as &dyn StageStore);
        let context = Context { progress: Some(progress), stages, ..Context::default() };
        let draw = |model: &Model, levels: &[Level]| png(&model.name, &contact_sheet(model, levels));
        let sheet: Option<Draw<'_>> = if self.args.sheet { Some(&draw) } else { None };
        self.in_pool(|| BakeResult::compute(source, settings, &context, sheet))
    }

    fn in_pool<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Writes the files that were asked for.
    fn write(&self, job: &Job, result: &BakeResult) -> Result<Written, Error> {
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
            let png = self.in_pool(|| draw_turntable(job, &result.levels))?;
            self.write_file(job, &path, &png)?;
            written.turntable = Some(path);
        }
        Ok(written)
    }

    fn write_file(&self, job: &Job, path: &Path, bytes: &[u8]) -> Result<(), Error> {
        // Whoever watches the file is not woken for nothing.
        if fs::read(path).is_ok_and(|there| there == bytes) {
            return Ok(());
        }
        let _hold = self.interrupt.hold();
        write_atomic(path, bytes, Durability::Process).map_err(|e| unwritable(job, path, &e))
    }

    /// Whether files can be made in the nearest folder that exists above the result. Leaves nothing behind.
    fn can_write(&self, job: &Job) -> Result<(), Error> {
        let path = job.combined_path();
        let there = path.ancestors().skip(1).find(|folder| folder.exists());
        let folder = there.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let _hold = self.interrupt.hold();
        can_write_in(folder).map_err(|e| unwritable(job, &path, &e))
    }
}

/// Drawn from the files of the levels, so that a result from the cache will do.
fn draw_turntable(job: &Job, levels: &[(u32, Vec<u8>)]) -> Result<Vec<u8>, Error> {
    let file = SourceFile::read(&job.input, &job.name)?;
    let model = import(&file.source(), &ImportLimits::default())?;
    let level = |(_, glb): &(u32, Vec<u8>)| {
        import(&Source { name: &job.name, bytes: glb, resources: &NoResources }, &ImportLimits::default())
    };
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
