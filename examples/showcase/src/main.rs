//! Bakes the models in `assets/` with their own settings. Levels and contact sheets appear in `target/showcase/`.
//!
//! Further arguments are those of `simpliguard bake`: `cargo run -- --quality draft`.

use std::process::ExitCode;
use std::{env, io};

fn main() -> io::Result<ExitCode> {
    env::set_current_dir(env!("CARGO_MANIFEST_DIR"))?;
    let args = ["showcase", "bake", "assets", "--output", "target/showcase", "--split-levels", "--sheet"];
    Ok(simpliguard_cli::run(args.map(Into::into).into_iter().chain(env::args_os().skip(1))))
}
