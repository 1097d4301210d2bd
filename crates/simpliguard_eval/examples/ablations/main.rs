//! What each part of the pipeline is worth: bakes models with one part after the other switched off (SimpliGuard, Figures 8
//! and 11), measures what the initial texture saves (Figure 9), and how time grows with the source (Figure 7). Draws the
//! figures into a folder.
//!
//! ```text
//! cargo run --release -p simpliguard_eval --example ablations -- [--faces 1000,2000,4000] [--views N] [--only TEXT,..]
//!     [--set field=value]... [--motion] [--pictures DIR] [--initialisation] [--runtime] FILE.glb...
//! ```

mod baking;
mod chart;
mod initialisation;
mod parts;
mod runtime;
mod sphere;
mod switches;

use std::error::Error;
use std::path::PathBuf;

use simpliguard::settings::{BakeOverrides, BakeSettings};

/// What was asked for.
struct Arguments {
    settings: BakeSettings,
    views: usize,
    /// Rows whose names contain one of these, beside all parts; all rows if there is none.
    only: Vec<String>,
    /// Also measure frames of the clips.
    motion: bool,
    pictures: Option<PathBuf>,
    initialisation: bool,
    runtime: bool,
    files: Vec<PathBuf>,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut overrides = BakeOverrides::default();
    let (mut views, mut only, mut pictures, mut files) = (20, Vec::new(), None, Vec::new());
    let (mut initialisation, mut runtime, mut motion) = (false, false, false);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--faces" => overrides.set("faces", &value()?)?,
            "--views" => views = value()?.parse()?,
            "--only" => only = value()?.split(',').map(str::to_owned).collect(),
            "--motion" => motion = true,
            "--set" => {
                let text = value()?;
                let (name, value) = text.split_once('=').ok_or("--set takes field=value")?;
                overrides.set(name, value)?;
            }
            "--pictures" => pictures = Some(value()?.into()),
            "--initialisation" => initialisation = true,
            "--runtime" => runtime = true,
            _ => files.push(word.into()),
        }
    }
    if files.is_empty() && !runtime {
        return Err("name at least one .glb file".into());
    }
    let settings = baking::resolved(&overrides)?;
    Ok(Arguments { settings, views, only, motion, pictures, initialisation, runtime, files })
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    if arguments.initialisation {
        initialisation::run(&arguments)?;
    } else if !arguments.files.is_empty() {
        parts::run(&arguments)?;
    }
    if arguments.runtime {
        runtime::run(&arguments)?;
    }
    Ok(())
}

#[allow(clippy::print_stdout, reason = "the tables are this program's output")]
fn say(line: &str) {
    println!("{line}");
}
