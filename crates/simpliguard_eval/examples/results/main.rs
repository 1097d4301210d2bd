//! The table of results: how much the levels of a folder of models look like their sources, beside those of meshoptimizer.
//!
//! ```text
//! cargo run --release -p simpliguard_eval --example results -- [--faces 1000,2000,4000] [--views N] [--baked DIR]
//!     [--lpips-weights FILE] [--bench DIR] FOLDER
//! ```
//!
//! It bakes every `.glb` file of the folder with the built-in settings, or takes `DIR/<name>_<budget>.glb`, as `simpliguard
//! bake --split-levels` writes them. meshoptimizer collapses the source's own mesh; its textures stay. With `--bench`, there is
//! no meshoptimizer, and a table of how much the figures of another benchmark differ.

mod agreement;
mod peer;
mod table;

use std::error::Error;
use std::path::{Path, PathBuf};

use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::settings::BakeSettings;
use simpliguard::{Context, NoResources, Source, bake};
use simpliguard_eval::Lpips;
use simpliguard_eval::compare::{Options, compare};

use table::Row;

/// What was asked for.
struct Arguments {
    faces: Vec<u32>,
    views: usize,
    baked: Option<PathBuf>,
    lpips: Option<Lpips>,
    /// Folder of the figures of another benchmark.
    bench: Option<PathBuf>,
    folder: PathBuf,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let (mut faces, mut views, mut folder) = (BakeSettings::default().faces, 20, None);
    let (mut baked, mut lpips, mut bench) = (None, None, None);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--faces" => faces = value()?.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--views" => views = value()?.parse()?,
            "--baked" => baked = Some(value()?.into()),
            "--bench" => bench = Some(PathBuf::from(value()?)),
            "--lpips-weights" => lpips = Some(Lpips::open(value()?.as_ref())?),
            _ => folder = Some(word.into()),
        }
    }
    Ok(Arguments { faces, views, baked, lpips, bench, folder: folder.ok_or("name the folder with the models")? })
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    let files = models_in(&arguments.folder)?;
    table::header();
    let mut rows = Vec::new();
    for file in &files {
        // A model that cannot be measured is named; the others count.
        match measure(file, &arguments) {
            Ok(measured) => rows.extend(measured),
            Err(error) => table::say(&format!("<!-- {}: {error} -->", file.display())),
        }
    }
    match &arguments.bench {
        Some(folder) => agreement::agreement(&rows, folder),
        None => {
            table::means(&arguments.faces, &rows);
            Ok(())
        }
    }
}

/// The binary glTFs of a folder, by name.
fn models_in(folder: &Path) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let paths: Vec<PathBuf> = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    let is_model = |path: &PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    let mut models: Vec<PathBuf> = paths.into_iter().filter(is_model).collect();
    models.sort();
    if models.is_empty() {
        return Err(format!("{}: there is no .glb file in this folder", folder.display()).into());
    }
    Ok(models)
}

/// Compares the levels of both methods with one source, and prints their rows.
fn measure(file: &Path, arguments: &Arguments) -> Result<Vec<Row>, Box<dyn Error>> {
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let bytes = std::fs::read(file)?;
    let source = import(&Source { name: &name, bytes: &bytes, resources: &NoResources }, &ImportLimits::default())?;
    let ours = match &arguments.baked {
        Some(folder) => read_levels(folder, &name, &arguments.faces)?,
        None => bake_levels(&name, &bytes, &arguments.faces)?,
    };
    let mut levels: Vec<(&'static str, u32, Model)> = Vec::new();
    for (budget, model) in ours {
        levels.push(("simpliguard", budget, model));
        if arguments.bench.is_none() {
            levels.push(("meshoptimizer", budget, peer::collapse(&source, budget as usize)?));
        }
    }
    let models: Vec<&Model> = levels.iter().map(|(_, _, model)| model).collect();
    let (volume, lpips) = (arguments.bench.is_some(), arguments.lpips.as_ref());
    let options = Options { views: arguments.views, volume, motion: false, lpips };
    let compared = compare(&source, &models, &options);
    let row = |(&(method, budget, _), comparison)| Row { model: name.clone(), method, budget, comparison };
    let rows: Vec<Row> = levels.iter().zip(compared).map(row).collect();
    rows.iter().for_each(|row| row.print());
    Ok(rows)
}

fn bake_levels(name: &str, bytes: &[u8], faces: &[u32]) -> Result<Vec<(u32, Model)>, Box<dyn Error>> {
    let settings = BakeSettings { faces: faces.to_vec(), ..BakeSettings::default() };
    let baked = bake(&Source { name, bytes, resources: &NoResources }, &settings, &Context::default())?;
    let Some(source) = baked.model.filter(|_| !baked.levels.is_empty()) else {
        return Err(format!("it gets no levels: it has {} triangles", baked.report.source_faces).into());
    };
    Ok(baked.levels.iter().map(|level| (level.budget, level.to_model(&source))).collect())
}

fn read_levels(folder: &Path, name: &str, faces: &[u32]) -> Result<Vec<(u32, Model)>, Box<dyn Error>> {
    let mut levels = Vec::new();
    for &budget in faces {
        let path = folder.join(format!("{name}_{budget}.glb"));
        let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let level = Source { name, bytes: &bytes, resources: &NoResources };
        levels.push((budget, import(&level, &ImportLimits::default())?));
    }
    Ok(levels)
}
