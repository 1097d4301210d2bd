//! The `simpliguard` command: bakes levels of detail into glTF files.
//!
//! Exit codes of `bake`: 0 all baked, 1 some failed (the others are written), 2 wrong usage (nothing was baked), 130
//! interrupted; of `cache`: 0 done, 1 something is damaged or could not be done, 2 wrong usage.
//!
//! A library, so that other programs of the workspace can do what the command does without starting it.

mod args;
mod bake;
mod cache;
mod console;
mod inputs;
mod interrupt;
mod plan;
mod project;
mod settings;
mod source;
mod summary;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

use args::{Args, Command};

/// A request that cannot be carried out as it stands; nothing was baked.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct UsageError(pub(crate) String);

impl From<simpliguard::Error> for UsageError {
    fn from(error: simpliguard::Error) -> Self {
        Self(error.to_string())
    }
}

/// Runs the command. The first argument is the program's name; wrong arguments and `--help` end the process.
pub fn run<T: Into<OsString> + Clone>(args: impl IntoIterator<Item = T>) -> ExitCode {
    let done = match Args::parse_from(args).command {
        Command::Bake(args) => bake::run(&args),
        Command::Cache(args) => cache::run(&args),
        Command::Settings(args) => settings::run(&args).map(|()| true),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            console::error(&error.to_string());
            ExitCode::from(2)
        }
    }
}
