//! `simpliguard farm`: bakes a library of models on many machines.
//!
//! ```text
//! plan    settings, keys, look-up in all tiers -> a bundle with a task for each chunk of what is missing
//! run     each task of the bundle here, by `openjd run`
//! submit  the tasks as job arrays of Slurm
//! status  all models again: what is there, what is not, and why
//! ```
//!
//! A bundle is a job of Open Job Description (`jobtemplate-2023-09`), so any scheduler that knows this format takes it. A
//! task is one `simpliguard bake` with a list of models. Its results go to the cache; nothing else connects the machines.
//! Results are found by their keys, so a task that is lost, repeated or run by another version does no harm: what is
//! missing then is in the next plan.

mod args;
mod bundle;
mod chunk;
mod cost;
mod local;
mod manifest;
mod plan;
mod scan;
mod slurm;
mod status;
mod template;
mod worker;

pub(crate) use args::FarmArgs;

use crate::Exit;
use crate::error::UsageError;
use args::FarmCommand;

/// Carries the command out.
pub(crate) fn run(args: &FarmArgs) -> Result<Exit, UsageError> {
    match &args.command {
        FarmCommand::Plan(args) => plan::run(args),
        FarmCommand::Run(args) => local::run(args),
        FarmCommand::Submit(args) => slurm::run(args),
        FarmCommand::Status(args) => status::run(args),
    }
}
