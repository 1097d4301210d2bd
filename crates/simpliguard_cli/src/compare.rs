//! `simpliguard compare`: how much levels look like their source, and how far they are from it.

use std::path::Path;

use serde::Serialize;
use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::{Error, Printable};
use simpliguard_eval::compare::{Comparison, Distances, MotionMetrics, Options, compare};

use crate::args::CompareArgs;
use crate::console;
use crate::error::UsageError;
use crate::levels::levels_of;
use crate::output::{columns, json_text, write_stdout};
use crate::project::nearest_project;
use crate::source::SourceFile;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

/// A model to compare.
struct Candidate {
    /// As in the table: the file, and the level in it.
    name: String,
    file: String,
    /// Its number in an output with several levels.
    level: Option<u64>,
    model: Model,
}

#[derive(Serialize)]
struct Document<'a> {
    version: u32,
    source: &'a str,
    /// Triangles of the source.
    faces: usize,
    views: usize,
    levels: Vec<Row<'a>>,
}

#[derive(Serialize)]
struct Row<'a> {
    file: &'a str,
    level: Option<u64>,
    #[serde(flatten)]
    comparison: &'a Comparison,
}

/// A column of the table: its title, and its cell.
type Column = (&'static str, fn(&Comparison) -> Option<String>);

const COLUMNS: [Column; 10] = [
    ("faces", |c| Some(c.faces.to_string())),
    ("PSNR", |c| Some(decibels(c.unlit.psnr))),
    ("foreground", |c| Some(decibels(c.unlit.psnr_foreground))),
    ("lit", |c| Some(decibels(c.lit.psnr))),
    ("SSIM", |c| Some(format!("{:.3}", c.unlit.ssim))),
    ("FLIP", |c| Some(format!("{:.3}", c.unlit.flip))),
    ("silhouette %", |c| Some(percent(c.silhouette_iou))),
    ("volume %", |c| c.iou_3d.map(percent)),
    ("Chamfer %", |c| c.distances.map(|Distances { chamfer, .. }| format!("{:.3}", 100.0 * chamfer))),
    ("Hausdorff %", |c| c.distances.map(|Distances { hausdorff, .. }| percent(hausdorff))),
];

/// The columns of `--motion`.
const MOTION_COLUMNS: [Column; 3] = [
    ("moving", |c| c.motion.map(|MotionMetrics { psnr, .. }| decibels(psnr))),
    ("foreground", |c| c.motion.map(|MotionMetrics { psnr_foreground, .. }| decibels(psnr_foreground))),
    ("worst drop", |c| c.motion.map(|MotionMetrics { worst_drop, .. }| decibels(worst_drop))),
];

pub(crate) fn run(args: &CompareArgs) -> Result<(), UsageError> {
    let (source, own) = open(&args.source, args.levels.is_empty())?;
    let mut candidates = own;
    for path in &args.levels {
        let (whole, levels) = open(path, true)?;
        if levels.is_empty() {
            candidates.push(whole);
        } else {
            candidates.extend(levels);
        }
    }
    if candidates.is_empty() {
        let source = &source.name;
        return Err(UsageError(format!("{source}: it holds no levels to compare; name the files of its levels")));
    }
    let options = Options { views: args.views.get().into(), motion: args.motion, ..Options::default() };
    let (count, views) = (candidates.len(), options.views);
    console::line(&format!("comparing {count} levels with {} over {views} views", Printable(&source.name)));
    let models: Vec<&Model> = candidates.iter().map(|candidate| &candidate.model).collect();
    let compared = compare(&source.model, &models, &options);
    let text = if args.json {
        json_text(&document(&source, &candidates, &compared, views))?
    } else {
        table(&candidates, &compared, args.motion)
    };
    write_stdout(&text)
}

/// Reads a model and, if wanted, the levels in it.
fn open(path: &Path, with_levels: bool) -> Result<(Candidate, Vec<Candidate>), Error> {
    let name = path.display().to_string();
    let project = path.canonicalize().ok().and_then(|path| nearest_project(&path));
    let file = SourceFile::read(path, &name, project.as_deref())?;
    let model = import(&file.source(), &ImportLimits::default())?;
    let json = &model.document.json;
    let mut levels = Vec::new();
    for level in levels_of(json).iter().filter(|_| with_levels) {
        let model = level.model(&name, json, file.source().bytes)?;
        let (file, name, level) = (name.clone(), format!("{name}, LOD{}", level.level), Some(level.level));
        levels.push(Candidate { name, file, level, model });
    }
    Ok((Candidate { file: name.clone(), name, level: None, model }, levels))
}

fn document<'a>(
    source: &'a Candidate,
    candidates: &'a [Candidate],
    compared: &'a [Comparison],
    views: usize,
) -> Document<'a> {
    let row = |(candidate, comparison): (&'a Candidate, &'a Comparison)| Row {
        file: &candidate.file,
        level: candidate.level,
        comparison,
    };
    let levels = candidates.iter().zip(compared).map(row).collect();
    let faces = source.model.surface.triangles.len();
    Document { version: DOCUMENT_VERSION, source: &source.file, faces, views, levels }
}

fn table(candidates: &[Candidate], compared: &[Comparison], motion: bool) -> String {
    let shown: Vec<&Column> = COLUMNS.iter().chain(MOTION_COLUMNS.iter().filter(|_| motion)).collect();
    let header = std::iter::once("level").chain(shown.iter().map(|(title, _)| *title)).map(str::to_owned).collect();
    let row = |(candidate, comparison): (&Candidate, &Comparison)| {
        let cells = shown.iter().map(|(_, cell)| cell(comparison).unwrap_or_else(|| "-".to_owned()));
        std::iter::once(Printable(&candidate.name).to_string()).chain(cells).collect()
    };
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(candidates.iter().zip(compared).map(row)).collect();
    columns(&rows, 1, false)
}

fn decibels(value: f64) -> String {
    format!("{value:.2}")
}

fn percent(fraction: f64) -> String {
    format!("{:.2}", 100.0 * fraction)
}
