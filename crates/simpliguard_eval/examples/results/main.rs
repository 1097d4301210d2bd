//! The table of results: how much the levels of a folder of models look like their sources, beside those of three peers.
//!
//! ```text
//! cargo run --release -p simpliguard_eval --example results -- [--faces 1000,2000,4000] [--set field=value]...
//!     [--views N] [--volume] [--baked DIR] [--lpips-weights FILE] [--bench DIR] FOLDER
//! ```
//!
//! It bakes every `.glb` file of the folder, or takes `DIR/<name>_<budget>.glb`, as `simpliguard
//! bake --split-levels` writes them. The peers are:
//!
//! - QEM: the welded mesh collapses by quadric error of positions alone; textures stay, by nearest points of the source;
//! - meshoptimizer: edge collapse of the source's own mesh, where attributes weigh in; textures stay;
//! - re-bake: our bake without differentiable rendering. A ray along the normal, or else the nearest point of the source, gives
//!   each texel; nothing is fitted to views.
//!
//! With `--bench`, there are no peers, and a table of how much the figures of another benchmark differ.

mod agreement;
mod meshoptimizer;
mod paper;
mod qem;
mod table;

use std::error::Error;
use std::path::{Path, PathBuf};

use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::settings::{BakeOverrides, BakeSettings, Layer, LevelMaterials, Origin, resolve};
use simpliguard::{Context, NoResources, Source, bake};
use simpliguard_eval::Lpips;
use simpliguard_eval::compare::{Options, compare};

use qem::Qem;
use table::Row;

/// What was asked for.
struct Arguments {
    settings: BakeSettings,
    views: usize,
    /// Also compare the volumes, which takes long.
    volume: bool,
    baked: Option<PathBuf>,
    lpips: Option<Lpips>,
    /// Folder of the figures of another benchmark.
    bench: Option<PathBuf>,
    folder: PathBuf,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut overrides = BakeOverrides::default();
    let (mut views, mut volume, mut folder) = (20, false, None);
    let (mut baked, mut lpips, mut bench) = (None, None, None);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--faces" => overrides.set("faces", &value()?)?,
            "--set" => {
                let text = value()?;
                let (name, value) = text.split_once('=').ok_or("--set takes field=value")?;
                overrides.set(name, value)?;
            }
            "--volume" => volume = true,
            "--views" => views = value()?.parse()?,
            "--baked" => baked = Some(value()?.into()),
            "--bench" => bench = Some(PathBuf::from(value()?)),
            "--lpips-weights" => lpips = Some(Lpips::open(value()?.as_ref())?),
            _ => folder = Some(word.into()),
        }
    }
    let folder = folder.ok_or("name the folder with the models")?;
    let settings = resolve(vec![Layer { origin: Origin::CommandLine, overrides }])?.settings;
    Ok(Arguments { settings, views, volume, baked, lpips, bench, folder })
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
            paper::tables(&arguments.settings.faces, &rows);
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

/// A level of one method: the method, the budget and the level.
type MethodLevel = (&'static str, u32, Model);

/// Compares the levels of all methods with one source, and prints their rows.
fn measure(file: &Path, arguments: &Arguments) -> Result<Vec<Row>, Box<dyn Error>> {
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let bytes = std::fs::read(file)?;
    let source = import(&Source { name: &name, bytes: &bytes, resources: &NoResources }, &ImportLimits::default())?;
    let settings = &arguments.settings;
    let ours = match &arguments.baked {
        Some(folder) => read_levels(folder, &name, &settings.faces)?,
        None => bake_levels(&name, &bytes, settings)?,
    };
    let budgets: Vec<u32> = ours.iter().map(|(budget, _)| *budget).collect();
    let mut levels: Vec<MethodLevel> = ours.into_iter().map(|(budget, model)| ("simpliguard", budget, model)).collect();
    if arguments.bench.is_none() {
        let rebaked = BakeSettings { refine: false, materials: LevelMaterials::Baked, ..settings.clone() };
        let rebaked = bake_levels(&name, &bytes, &rebaked)?;
        levels.extend(rebaked.into_iter().map(|(budget, model)| ("re-bake", budget, model)));
        collapsed(&source, &budgets, &mut levels)?;
    }
    let models: Vec<&Model> = levels.iter().map(|(_, _, model)| model).collect();
    let volume = arguments.volume || arguments.bench.is_some();
    let options = Options { views: arguments.views, volume, motion: false, lpips: arguments.lpips.as_ref() };
    let compared = compare(&source, &models, &options);
    let textured = source.materials.iter().any(|material| material.base_color_texture.is_some());
    let row = |(&(method, budget, _), comparison)| Row { model: name.clone(), textured, method, budget, comparison };
    let rows: Vec<Row> = levels.iter().zip(compared).map(row).collect();
    rows.iter().for_each(|row| row.print());
    Ok(rows)
}

/// Adds the levels of the peers that collapse the source.
fn collapsed(source: &Model, budgets: &[u32], levels: &mut Vec<MethodLevel>) -> Result<(), Box<dyn Error>> {
    let qem = Qem::new(source);
    for &budget in budgets {
        levels.push(("meshoptimizer", budget, meshoptimizer::collapse(source, budget as usize)?));
        levels.push(("QEM", budget, qem.collapse(budget as usize)));
    }
    Ok(())
}

fn bake_levels(name: &str, bytes: &[u8], settings: &BakeSettings) -> Result<Vec<(u32, Model)>, Box<dyn Error>> {
    let baked = bake(&Source { name, bytes, resources: &NoResources }, settings, &Context::default())?;
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
