//! The tables, as Markdown.

use simpliguard_eval::compare::{Comparison, ImageMetrics};

/// The methods, in the order of the columns.
const METHODS: [&str; 2] = ["simpliguard", "meshoptimizer"];

/// A level of one method.
pub(crate) struct Row {
    pub(crate) model: String,
    pub(crate) method: &'static str,
    pub(crate) budget: u32,
    pub(crate) comparison: Comparison,
}

/// The head of the table of all levels.
pub(crate) fn header() {
    say(
        "| model | budget | | triangles | PSNR, dB | foreground | PSNR lit, dB | SSIM | FLIP | NLPIPS | silhouette IoU, % |",
    );
    say("|---|---|---|---|---|---|---|---|---|---|---|");
}

impl Row {
    /// Prints the row of a model.
    pub(crate) fn print(&self) {
        let Self {
            model,
            method,
            budget,
            comparison: Comparison { faces, unlit, lit, perceptual, silhouette_iou, .. },
        } = self;
        let ImageMetrics { psnr, psnr_foreground, ssim, flip } = unlit;
        let silhouette = 100.0 * silhouette_iou;
        let nlpips = perceptual.map_or_else(|| "-".to_owned(), |p| format!("{:.3}", p.nlpips));
        say(&format!(
            "| {model} | {budget} | {method} | {faces} | {psnr:.2} | {psnr_foreground:.2} | {:.2} | {ssim:.3} | \
             {flip:.3} | {nlpips} | {silhouette:.1} |",
            lit.psnr
        ));
    }
}

/// The table of means: a row for each budget, over the models that have a level for it.
pub(crate) fn means(budgets: &[u32], rows: &[Row]) {
    say("");
    say(&format!("| triangles | models | {} | {}, lit |", METHODS.join(" | "), METHODS.join(", lit | ")));
    say(&format!("|---|---|{}", "---|".repeat(2 * METHODS.len())));
    for &budget in budgets {
        let of = |method: &'static str| rows.iter().filter(move |row| row.budget == budget && row.method == method);
        let models = of(METHODS[0]).count();
        if models == 0 {
            continue;
        }
        let cells: Vec<String> = [|c: &Comparison| c.unlit, |c: &Comparison| c.lit]
            .iter()
            .flat_map(|image| METHODS.map(|method| mean(of(method).map(|row| image(&row.comparison).psnr))))
            .collect();
        say(&format!("| {budget} | {models} | {} |", cells.join(" | ")));
    }
}

fn mean(values: impl Iterator<Item = f64>) -> String {
    let values: Vec<f64> = values.collect();
    format!("{:.2}", values.iter().sum::<f64>() / values.len().max(1) as f64)
}

#[allow(clippy::print_stdout, reason = "the tables are this program's output")]
pub(crate) fn say(line: &str) {
    println!("{line}");
}
