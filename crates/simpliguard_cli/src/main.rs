//! The `simpliguard` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    simpliguard_cli::run(std::env::args_os())
}
