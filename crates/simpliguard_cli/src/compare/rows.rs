//! The rows of a comparison, as a table and as JSON.

use serde::Serialize;
use simpliguard::Printable;
use simpliguard_eval::compare::{Comparison, Distances, MotionMetrics, Options, PerceptualMetrics};

use crate::output::columns;

/// Version of the JSON document. It is raised when a field changes its meaning or is removed.
const DOCUMENT_VERSION: u32 = 1;

/// The JSON document.
#[derive(Serialize)]
pub(super) struct Document<'a> {
    version: u32,
    source: &'a str,
    /// Triangles of the source.
    faces: usize,
    views: usize,
    levels: &'a [Row],
}

/// What is compared.
#[derive(Clone, Serialize)]
pub(super) struct Subject {
    pub(super) file: String,
    /// The name of a level in an output of `bake`. Null for a file of its own.
    pub(super) name: Option<String>,
    /// Its number in such an output.
    pub(super) level: Option<u64>,
    #[serde(flatten)]
    pub(super) object: Option<ObjectOf>,
}

/// The objects whose level is compared.
#[derive(Clone, Serialize)]
pub(super) struct ObjectOf {
    pub(super) object: String,
    pub(super) instances: usize,
    /// Triangles of one instance of the source.
    pub(super) source_faces: usize,
}

#[derive(Serialize)]
pub(super) struct Row {
    #[serde(flatten)]
    pub(super) subject: Subject,
    #[serde(flatten)]
    pub(super) comparison: Comparison,
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

/// The columns of `--lpips-weights`.
const LPIPS_COLUMNS: [Column; 2] = [
    ("LPIPS", |c| c.perceptual.map(|PerceptualMetrics { lpips, .. }| format!("{lpips:.4}"))),
    ("NLPIPS", |c| c.perceptual.map(|PerceptualMetrics { nlpips, .. }| format!("{nlpips:.4}"))),
];

/// The columns of `--motion`.
const MOTION_COLUMNS: [Column; 5] = [
    ("moving", |c| c.motion.map(|MotionMetrics { psnr, .. }| decibels(psnr))),
    ("foreground", |c| c.motion.map(|MotionMetrics { psnr_foreground, .. }| decibels(psnr_foreground))),
    ("lit", |c| c.motion.map(|MotionMetrics { psnr_lit, .. }| decibels(psnr_lit))),
    ("worst drop", |c| c.motion.map(|MotionMetrics { worst_drop, .. }| decibels(worst_drop))),
    ("lit", |c| c.motion.map(|MotionMetrics { worst_drop_lit, .. }| decibels(worst_drop_lit))),
];

impl<'a> Document<'a> {
    pub(super) fn new(source: &'a str, faces: usize, views: usize, levels: &'a [Row]) -> Self {
        Self { version: DOCUMENT_VERSION, source, faces, views, levels }
    }
}

impl Subject {
    /// As in the table: the file, the objects, and the level.
    fn label(&self) -> String {
        let object = self.object.as_ref().map(|ObjectOf { object, instances, .. }| match instances {
            1 => object.clone(),
            _ => format!("{object} ({instances} instances)"),
        });
        let parts = [Some(&self.file), object.as_ref(), self.name.as_ref()];
        parts.into_iter().flatten().map(String::as_str).collect::<Vec<_>>().join(", ")
    }
}

/// The table, with the columns of what was asked for.
pub(super) fn table(rows: &[Row], options: &Options<'_>) -> String {
    let lpips = LPIPS_COLUMNS.iter().filter(|_| options.lpips.is_some());
    let motion = MOTION_COLUMNS.iter().filter(|_| options.motion);
    let shown: Vec<&Column> = COLUMNS.iter().chain(lpips).chain(motion).collect();
    let header = std::iter::once("level").chain(shown.iter().map(|(title, _)| *title)).map(str::to_owned).collect();
    let cells = |Row { subject, comparison }: &Row| {
        let cells = shown.iter().map(|(_, cell)| cell(comparison).unwrap_or_else(|| "-".to_owned()));
        std::iter::once(Printable(&subject.label()).to_string()).chain(cells).collect()
    };
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(rows.iter().map(cells)).collect();
    columns(&rows, 1, false)
}

fn decibels(value: f64) -> String {
    format!("{value:.2}")
}

fn percent(fraction: f64) -> String {
    format!("{:.2}", 100.0 * fraction)
}
