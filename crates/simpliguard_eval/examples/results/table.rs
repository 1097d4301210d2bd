//! The table of all levels, as Markdown.

use simpliguard_eval::compare::{Comparison, ImageMetrics};

/// The methods, in the order of the columns.
pub(crate) const METHODS: [&str; 4] = ["QEM", "meshoptimizer", "re-bake", "simpliguard"];

/// A level of one method.
pub(crate) struct Row {
    pub(crate) model: String,
    /// The model has a texture for its base colour.
    pub(crate) textured: bool,
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
            ..
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

#[allow(clippy::print_stdout, reason = "the tables are this program's output")]
pub(crate) fn say(line: &str) {
    println!("{line}");
}
