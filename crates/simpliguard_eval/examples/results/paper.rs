//! The form of the paper's Table 1: the methods over the same models, for each number of triangles.
//!
//! Models with and without textures are apart. A white model without textures cannot be seen without light on white: every
//! method scores 100 dB. It is left out of the means without light.

use std::collections::BTreeSet;

use simpliguard_eval::compare::Comparison;

use crate::table::{METHODS, Row, say};

/// PSNR of images that are alike, in dB.
const ALIKE: f64 = 100.0;

/// A figure of a level; `None` if it was not measured.
type Figure = fn(&Comparison) -> Option<f64>;

/// A figure over models: its title, the figure, its digits behind the point, and whether it is one without light.
struct Column {
    title: &'static str,
    figure: Figure,
    digits: usize,
    is_unlit: bool,
}

const COLUMNS: [Column; 6] = [
    Column { title: "PSNR, dB", figure: |c| Some(c.unlit.psnr), digits: 2, is_unlit: true },
    Column { title: "PSNR lit, dB", figure: |c| Some(c.lit.psnr), digits: 2, is_unlit: false },
    Column { title: "SSIM", figure: |c| Some(c.unlit.ssim), digits: 3, is_unlit: true },
    Column { title: "NLPIPS", figure: |c| c.perceptual.map(|p| p.nlpips), digits: 3, is_unlit: true },
    Column { title: "silhouette IoU, %", figure: |c| Some(100.0 * c.silhouette_iou), digits: 1, is_unlit: false },
    Column { title: "volume IoU, %", figure: |c| c.iou_3d.map(|iou| 100.0 * iou), digits: 1, is_unlit: false },
];

/// Prints the tables for each number of triangles.
pub(crate) fn tables(budgets: &[u32], rows: &[Row]) {
    let unseen = unseen(rows);
    for (group, is_textured) in [("with textures", true), ("without textures", false)] {
        let rows: Vec<&Row> = rows.iter().filter(|row| row.textured == is_textured).collect();
        for &budget in budgets {
            let rows: Vec<&Row> = rows.iter().copied().filter(|row| row.budget == budget).collect();
            if !rows.is_empty() {
                say(&format!("\n**{budget} triangles, models {group}**\n"));
                by_model(&rows, &unseen);
                by_method(&rows, &unseen);
            }
        }
    }
    if !unseen.is_empty() {
        let names: Vec<&str> = unseen.into_iter().collect();
        say(&format!("\nWhite on white, and left out of the means without light: {}.", names.join(", ")));
    }
}

/// The models that no view shows without light: all their levels score [`ALIKE`].
fn unseen(rows: &[Row]) -> BTreeSet<&str> {
    let seen: BTreeSet<&str> =
        rows.iter().filter(|row| row.comparison.unlit.psnr < ALIKE).map(|row| row.model.as_str()).collect();
    rows.iter().map(|row| row.model.as_str()).filter(|model| !seen.contains(model)).collect()
}

/// A row for each model and one of the means: PSNR of each method, without and with light.
fn by_model(rows: &[&Row], unseen: &BTreeSet<&str>) {
    let columns = &COLUMNS[..2];
    let titles: Vec<String> =
        columns.iter().flat_map(|column| METHODS.map(|method| format!("{method}, {}", column.title))).collect();
    say(&format!("| model | {} |", titles.join(" | ")));
    say(&format!("|---|{}", "---|".repeat(titles.len())));
    let mut models: Vec<&str> = rows.iter().map(|row| row.model.as_str()).collect();
    models.dedup();
    for model in models {
        let of = |method: &'static str| rows.iter().filter(move |row| row.model == model && row.method == method);
        let cell = |column: &Column, method| column.mean(of(method).map(|row| &row.comparison));
        let cells: Vec<String> = columns.iter().flat_map(|column| METHODS.map(|method| cell(column, method))).collect();
        say(&format!("| {model} | {} |", cells.join(" | ")));
    }
    let cell = |column: &Column, method| column.mean_of(rows, method, unseen);
    let cells: Vec<String> = columns.iter().flat_map(|column| METHODS.map(|method| cell(column, method))).collect();
    say(&format!("| mean | {} |", cells.join(" | ")));
}

/// A row for each method: the means of all figures.
fn by_method(rows: &[&Row], unseen: &BTreeSet<&str>) {
    say(&format!("\n| method | models | {} |", COLUMNS.map(|column| column.title).join(" | ")));
    say(&format!("|---|---|{}", "---|".repeat(COLUMNS.len())));
    for method in METHODS {
        let models = rows.iter().filter(|row| row.method == method).count();
        let cells = COLUMNS.map(|column| column.mean_of(rows, method, unseen));
        say(&format!("| {method} | {models} | {} |", cells.join(" | ")));
    }
}

impl Column {
    /// The mean over the models of a method, without those that this figure does not see.
    fn mean_of(&self, rows: &[&Row], method: &str, unseen: &BTreeSet<&str>) -> String {
        let is_seen = |row: &&&Row| row.method == method && !(self.is_unlit && unseen.contains(row.model.as_str()));
        self.mean(rows.iter().filter(is_seen).map(|row| &row.comparison))
    }

    fn mean<'c>(&self, all: impl Iterator<Item = &'c Comparison>) -> String {
        let values: Vec<f64> = all.filter_map(self.figure).collect();
        if values.is_empty() {
            return "-".to_owned();
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        format!("{mean:.digits$}", digits = self.digits)
    }
}
