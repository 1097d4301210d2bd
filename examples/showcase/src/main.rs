//! The models in `assets/` as a game shows them: every level side by side, and rows that go into the distance.
//!
//! `cargo run` opens the game; keys are in its corner. `cargo run -- --screenshot DIR` writes pictures of it and ends.
//! Where no window opens, and with `--headless`, the models are baked without the game, with contact sheets in
//! `target/showcase/`. Further arguments are those of `simpliguard bake`: `cargo run -- --quality draft`.

mod camera;
mod clips;
mod exhibits;
mod fit;
mod game;
mod help;
mod labels;
mod layout;
mod markers;
mod photos;
mod request;
mod stage;

use std::ffi::OsString;
use std::process::ExitCode;
use std::{env, io};

use bevy::app::AppExit;

use request::Request;

fn main() -> io::Result<ExitCode> {
    env::set_current_dir(env!("CARGO_MANIFEST_DIR"))?;
    match Request::parse(env::args_os().skip(1)) {
        Ok(Request::Bake(args)) => Ok(bake(args)),
        Ok(Request::Game { photos }) => Ok(play(photos)),
        Err(message) => {
            say(&message);
            Ok(ExitCode::from(2))
        }
    }
}

/// Plays the game. Where it cannot open, bakes instead; pictures that were asked for are a failure then.
fn play(photos: Option<std::path::PathBuf>) -> ExitCode {
    let photographed = photos.is_some();
    match game::open(photos) {
        Ok(mut app) => match app.run() {
            AppExit::Success => ExitCode::SUCCESS,
            AppExit::Error(code) => ExitCode::from(code.get()),
        },
        Err(reason) if photographed => {
            say(&format!("no screenshots: {reason}"));
            ExitCode::FAILURE
        }
        Err(reason) => {
            say(&format!("the game is skipped ({reason}); the models are baked to target/showcase instead"));
            bake(Vec::new())
        }
    }
}

/// Bakes the models with their own settings: levels and contact sheets in `target/showcase/`, a table on stdout.
fn bake(args: Vec<OsString>) -> ExitCode {
    let own = ["showcase", "bake", "assets", "--output", "target/showcase", "--split-levels", "--sheet"];
    simpliguard_cli::run(own.map(OsString::from).into_iter().chain(args))
}

#[expect(clippy::print_stderr, reason = "a program's own messages")]
fn say(message: &str) {
    eprintln!("showcase: {message}");
}
