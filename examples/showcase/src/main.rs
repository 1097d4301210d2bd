//! Bakes the models in `assets/` with their own settings. Levels and contact sheets appear in `target/showcase/`.
//!
//! Further arguments are those of `simpliguard bake`: `cargo run -- --quality draft`.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let args: [OsString; 7] = [
        "showcase".into(),
        "bake".into(),
        root.join("assets").into(),
        "--output".into(),
        root.join("target/showcase").into(),
        "--split-levels".into(),
        "--sheet".into(),
    ];
    simpliguard_cli::run(args.into_iter().chain(std::env::args_os().skip(1)))
}
