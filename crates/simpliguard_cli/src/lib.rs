//! The `simpliguard` command: bakes levels of detail into glTF files.
//!
//! Exit codes of `bake`: 0 all baked, 1 some failed (the others are written), 2 wrong usage (nothing was baked), 3 a level
//! misses a bar of the gate (all are written), 130 interrupted. Exit codes of `cache`: 0 done, 1 something is damaged or
//! could not be done, 2 wrong usage. Exit codes of `farm`: 0 done, 1 some models failed or are not baked, 2 wrong usage.
//!
//! It is a library, so that other programs of the workspace can run the command without starting a process.

mod args;
mod bake;
mod bench;
mod boundary;
mod cache;
mod compare;
mod console;
mod deadline;
mod error;
mod farm;
mod gate;
mod images;
mod inputs;
mod inspect;
mod interrupt;
mod levels;
mod output;
mod pattern;
mod plan;
mod project;
mod report;
mod runner;
mod settings;
mod settings_sources;
mod source;
mod summary;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;
use simpliguard_bake::isolation;

use args::{Args, Command};

/// Runs the command. The first argument is the name of the program. Wrong arguments and `--help` end the process.
pub fn run<T: Into<OsString> + Clone>(args: impl IntoIterator<Item = T>) -> ExitCode {
    if isolation::is_child() {
        bake::serve();
    }
    let done = match Args::parse_from(args).command {
        Command::Bake(args) => bake::run(&args),
        Command::Cache(args) => cache::run(&args),
        Command::Settings(args) => settings::run(&args).map(|()| Exit::Done),
        Command::Inspect(args) => inspect::run(&args).map(|()| Exit::Done),
        Command::Compare(args) => compare::run(&args).map(|()| Exit::Done),
        Command::Report(args) => report::run(&args),
        Command::Farm(args) => farm::run(&args),
        Command::Bench(args) => bench::run(&args).map(|()| Exit::Done),
    };
    let exit = done.unwrap_or_else(|error| {
        console::error(&error.to_string());
        Exit::WrongUsage
    });
    ExitCode::from(exit as u8)
}

/// Exit codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exit {
    Done = 0,
    SomeFailed = 1,
    WrongUsage = 2,
    GateFailed = 3,
}
