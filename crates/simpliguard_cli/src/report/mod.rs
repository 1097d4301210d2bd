//! `simpliguard report`: one HTML page of models and their levels, with figures, pictures and a 3-D view.

mod asset;
mod objects;
mod page;
mod preview;

use std::io;
use std::time::Instant;

use bytesize::ByteSize;
use simpliguard::Printable;
use simpliguard_bake::Parts;
use simpliguard_cache::{Durability, write_atomic};
use simpliguard_eval::Lpips;
use simpliguard_eval::compare::Options;

use self::asset::{Asset, Measured, shared_folder};
use self::page::Page;
use crate::Exit;
use crate::args::ReportArgs;
use crate::console::{self, AssetProgress};
use crate::error::UsageError;
use crate::output::can_create;
use crate::plan::{Job, jobs};
use crate::runner::{Request, Runner};
use crate::source::SourceFile;

/// Characters of base64 for three bytes.
const BASE64_GROUP: u64 = 4;

/// Writes the page.
pub(crate) fn run(args: &ReportArgs) -> Result<Exit, UsageError> {
    let jobs = jobs(&args.models, args.out.as_path())?;
    let lpips = args.lpips_weights.as_deref().map(Lpips::open).transpose()?;
    let options = Options { views: args.views.get().into(), volume: false, motion: false, lpips: lpips.as_ref() };
    let runner = Runner::new(&args.models)?;
    runner.probe(&jobs)?;
    // Bakes take too long to find out afterwards.
    can_create(&args.out).map_err(|e| unwritable(args, &e))?;
    let mut budget =
        Budget { left: args.max_size.as_u64().saturating_sub(page::FIXED_BYTES), models: jobs.len() as u64 };
    let names: Vec<&str> = jobs.iter().map(|job| job.name.as_str()).collect();
    let shared = shared_folder(&names);
    let mut assets = Vec::with_capacity(jobs.len());
    for (number, job) in jobs.iter().enumerate() {
        let progress = AssetProgress::new(number + 1, jobs.len(), &job.name);
        let label = job.name.get(shared..).unwrap_or(&job.name).to_owned();
        let result = report_on(&options, &runner, job, progress, &mut budget);
        assets.push(Asset { name: job.name.clone(), label, result });
    }
    runner.finish();
    let all_done = assets.iter().all(|asset| asset.result.is_ok());
    let html = Page { assets: &assets, views: args.views.get() }.html();
    write(args, &runner, &html)?;
    Ok(if all_done { Exit::Done } else { Exit::SomeFailed })
}

/// One model: its result, its figures and its pictures. A failure is that of this model alone.
fn report_on(
    options: &Options<'_>,
    runner: &Runner<'_>,
    job: &Job,
    progress: AssetProgress,
    budget: &mut Budget,
) -> Result<Measured, String> {
    let start = Instant::now();
    let result = job.settings.as_ref().map_err(ToString::to_string).and_then(|resolved| {
        let file = SourceFile::read(&job.input, &job.name, job.cache.project()).map_err(|e| e.to_string())?;
        let (settings, parts, progress) = (&resolved.settings, Parts::Combined, &progress);
        let request = Request { job, file: &file, settings, parts, progress, begin: &|| Ok(()) };
        let outcome = runner.find_or_bake(&request).map_err(|e| e.to_string())?;
        let seconds = start.elapsed().as_secs_f64();
        let measures = (options, budget.share());
        runner.in_pool(|| Measured::new(job, &file, outcome, seconds, measures)).map_err(|e| e.to_string())
    });
    budget.spend(result.as_ref().map_or(0, Measured::bytes));
    let outcome = match &result {
        Ok(measured) => format!("{} in {:.2} s", measured.status_text(), start.elapsed().as_secs_f64()),
        Err(error) => format!("failed\nerror: {}", Printable(error)),
    };
    progress.finish(&outcome);
    result
}

fn write(args: &ReportArgs, runner: &Runner<'_>, html: &str) -> Result<(), UsageError> {
    let path = args.out.display();
    let hold = runner.interrupt.hold();
    write_atomic(&args.out, html.as_bytes(), Durability::Process).map_err(|e| unwritable(args, &e))?;
    drop(hold);
    let size = ByteSize(html.len() as u64);
    console::line(&format!("wrote {path} with {}", size.display().si()));
    if size > args.max_size {
        let most = args.max_size.display().si();
        console::warning(&format!("the page is larger than {most}; report on fewer models, or raise --max-size"));
    }
    Ok(())
}

fn unwritable(args: &ReportArgs, error: &io::Error) -> UsageError {
    let path = args.out.display();
    UsageError(format!("cannot write {path}: {error}; check the folder and the space on its disk"))
}

/// The bytes that are left for models in the page. What one leaves over, the next ones have.
struct Budget {
    left: u64,
    /// Models to come.
    models: u64,
}

impl Budget {
    /// The bytes of the next model, before they are encoded for the page.
    fn share(&self) -> u64 {
        self.left / self.models.max(1) / BASE64_GROUP * 3
    }

    /// Takes the bytes of a model away.
    fn spend(&mut self, bytes: u64) {
        self.left = self.left.saturating_sub(bytes.div_ceil(3) * BASE64_GROUP);
        self.models = self.models.saturating_sub(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_model_leaves_over_the_next_ones_have() {
        let mut budget = Budget { left: 1200, models: 3 };
        assert_eq!(budget.share(), 300);
        budget.spend(30);
        assert_eq!((budget.left, budget.share()), (1160, 435));
        budget.spend(u64::from(u32::MAX));
        assert_eq!((budget.left, budget.share()), (0, 0));
        budget.spend(0);
        assert_eq!(budget.share(), 0);
    }
}
