//! `simpliguard bake`: bakes one model after another, each on all threads.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};
use std::time::Instant;

use image::{ImageFormat, RgbImage};
use simpliguard::data::{Level, Model};
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::settings::BakeSettings;
use simpliguard::{Error, NoResources, Source, StageId};
use simpliguard_bake::{BakeResult, Outcome, Parts, isolation};
use simpliguard_cache::{Durability, read_bounded, remove_stale_temporaries, write_atomic};
use simpliguard_eval::{TurntableError, contact_sheet, turntable};

use crate::Exit;
use crate::args::BakeArgs;
use crate::console::AssetProgress;
use crate::error::UsageError;
use crate::output::can_create;
use crate::plan::{Job, plan};
use crate::runner::{Request, Runner};
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

/// Bakes one model for the command that has started this process; see `--isolate`.
pub(crate) fn serve() -> ! {
    isolation::serve(&draw_sheet, || {})
}

fn draw_sheet(model: &Model, levels: &[Level]) -> Result<Vec<u8>, Error> {
    png(&model.name, &contact_sheet(model, levels))
}

fn bake_all(args: &BakeArgs) -> Result<Exit, UsageError> {
    let jobs = plan(args)?;
    let writer = Writer::new(args)?;
    writer.runner.probe(&jobs)?;
    let bake = |(number, job)| writer.bake(job, AssetProgress::new(number + 1, jobs.len(), &job.name));
    let reports: Vec<JobReport> = jobs.iter().enumerate().map(bake).collect();
    let counters = writer.runner.finish();
    summary::print(&reports, &counters, args.json, args.report.as_deref())?;
    Ok(summary::exit(&reports))
}

/// Bakes models and writes their results.
struct Writer<'a> {
    args: &'a BakeArgs,
    runner: Runner<'a>,
    /// Output folders without stale temporary files.
    swept: RefCell<BTreeSet<PathBuf>>,
}

impl<'a> Writer<'a> {
    fn new(args: &'a BakeArgs) -> Result<Self, UsageError> {
        Ok(Self { args, runner: Runner::new(&args.models)?, swept: RefCell::default() })
    }

    fn bake(&self, job: &Job, progress: AssetProgress) -> JobReport {
        let start = Instant::now();
        let result = job.settings.as_ref().map_err(ToString::to_string).and_then(|resolved| {
            let settings = &resolved.settings;
            let file = SourceFile::read(&job.input, &job.name, job.cache.project()).map_err(|e| e.to_string())?;
            let mut outcome = self.find_or_bake(job, &file, settings, &progress).map_err(|e| e.to_string())?;
            let written = self.write(job, &file, &outcome.result).map_err(|e| e.to_string())?;
            if !job.input.exists() {
                outcome.result.report.notes.push(GONE.to_owned());
            }
            let missed = self.args.gate.check(&outcome.result.report, settings);
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
        let parts = if self.args.sheet { Parts::Sheet(&draw_sheet) } else { Parts::Levels };
        // The output folder is checked first, because a bake takes too long to find out afterwards.
        let begin = || self.can_write(job);
        self.runner.find_or_bake(&Request { job, file, settings, parts, progress, begin: &begin })
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
            let memory = self.runner.memory;
            let png = self.runner.in_pool(|| draw_turntable(job, file, &result.levels, memory))?;
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
        let _hold = self.runner.interrupt.hold();
        write_atomic(path, bytes, Durability::Process).map_err(|e| unwritable(job, path, &e))
    }

    /// Removes what killed runs have left in the folder of an output.
    fn sweep(&self, output: &Path) {
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if self.swept.borrow_mut().insert(folder.to_owned()) {
            remove_stale_temporaries(folder);
        }
    }

    /// Checks that the result can be written.
    fn can_write(&self, job: &Job) -> Result<(), Error> {
        let path = job.combined_path();
        let _hold = self.runner.interrupt.hold();
        can_create(&path).map_err(|e| unwritable(job, &path, &e))
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
