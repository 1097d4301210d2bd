//! The same figures from another benchmark, side by side with ours.
//!
//! That benchmark writes one JSON document for each level, `<model>_ours_<budget>.json`. Its fields are those that
//! [`FIGURES`] names; others are not read.

use std::error::Error;
use std::path::Path;

use serde_json::Value;
use simpliguard_eval::compare::Comparison;

use crate::table::{Row, say};

/// A figure that both measure.
struct Figure {
    name: &'static str,
    /// Where the other benchmark has it.
    pointer: &'static str,
    /// Ours, in the same unit.
    ours: fn(&Comparison) -> Option<f64>,
    /// Digits behind the point.
    digits: usize,
}

const FIGURES: [Figure; 10] = [
    Figure { name: "PSNR, dB", pointer: "/unlit/psnr", ours: |c| Some(c.unlit.psnr), digits: 3 },
    Figure { name: "foreground, dB", pointer: "/unlit/psnr_fg", ours: |c| Some(c.unlit.psnr_foreground), digits: 3 },
    Figure { name: "PSNR lit, dB", pointer: "/lit/psnr", ours: |c| Some(c.lit.psnr), digits: 3 },
    Figure { name: "SSIM", pointer: "/unlit/ssim", ours: |c| Some(c.unlit.ssim), digits: 5 },
    Figure { name: "LPIPS", pointer: "/unlit/lpips", ours: |c| c.perceptual.map(|p| p.lpips), digits: 5 },
    Figure { name: "NLPIPS", pointer: "/unlit/nlpips", ours: |c| c.perceptual.map(|p| p.nlpips), digits: 5 },
    Figure { name: "silhouette IoU", pointer: "/silhouette_iou", ours: |c| Some(c.silhouette_iou), digits: 5 },
    Figure { name: "volume IoU", pointer: "/iou3d", ours: |c| c.iou_3d, digits: 5 },
    Figure { name: "Chamfer, %", pointer: "/chamfer_pct", ours: |c| c.distances.map(|d| 100.0 * d.chamfer), digits: 4 },
    Figure {
        name: "Hausdorff, %",
        pointer: "/hausdorff_pct",
        ours: |c| c.distances.map(|d| 100.0 * d.hausdorff),
        digits: 3,
    },
];

/// A level that both have measured.
struct Pair<'a> {
    row: &'a Row,
    other: Value,
}

/// Prints how much our figures differ from those in `folder`.
pub(crate) fn agreement(rows: &[Row], folder: &Path) -> Result<(), Box<dyn Error>> {
    let mut pairs = Vec::new();
    for row in rows {
        let path = folder.join(format!("{}_ours_{}.json", row.model, row.budget));
        let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        pairs.push(Pair { row, other: serde_json::from_slice(&bytes)? });
    }
    say("");
    say("| figure | levels | mean, ours | mean, other | mean difference | 95 % within | largest | of |");
    say("|---|---|---|---|---|---|---|---|");
    FIGURES.iter().for_each(|figure| figure.print(&pairs));
    Ok(())
}

impl Figure {
    fn print(&self, pairs: &[Pair<'_>]) {
        let values = |pair: &Pair<'_>| {
            let both = ((self.ours)(&pair.row.comparison)?, pair.other.pointer(self.pointer)?.as_f64()?);
            Some((both, format!("{} {}", pair.row.model, pair.row.budget)))
        };
        let mut values: Vec<((f64, f64), String)> = pairs.iter().filter_map(values).collect();
        let difference = |((ours, other), _): &((f64, f64), String)| (ours - other).abs();
        values.sort_by(|a, b| difference(a).total_cmp(&difference(b)));
        let Some(largest) = values.last() else { return };
        let (count, digits) = (values.len(), self.digits);
        let mean = |of: &dyn Fn(&((f64, f64), String)) -> f64| values.iter().map(of).sum::<f64>() / count as f64;
        let most = difference(&values[(count * 95).div_ceil(100) - 1]);
        say(&format!(
            "| {} | {count} | {:.digits$} | {:.digits$} | {:.digits$} | {most:.digits$} | {:.digits$} | {} |",
            self.name,
            mean(&|v| v.0.0),
            mean(&|v| v.0.1),
            mean(&difference),
            difference(largest),
            largest.1
        ));
    }
}
