//! The bars that levels must meet.

use serde::{Deserialize, Serialize};

use super::report::LevelReport;
use crate::settings::{BakeSettings, OnMiss};

/// Bars that a level must meet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bars {
    /// Least PSNR in dB of the level's likeness; 0 asks for nothing.
    pub min_psnr: f32,
    /// Least overlap of the silhouettes, 0 to 1; 0 asks for nothing.
    pub min_silhouette_iou: f32,
    /// Largest distance to the source that 95 % of both surfaces stay within, as a fraction of the bounding box's diagonal; 1
    /// asks for nothing.
    pub max_deviation: f32,
}

impl Bars {
    /// The bars that `settings` ask for.
    pub fn of(settings: &BakeSettings) -> Self {
        let BakeSettings { min_psnr, min_silhouette_iou, max_deviation, .. } = *settings;
        Self { min_psnr, min_silhouette_iou, max_deviation }
    }

    /// The bars that a level misses. A likeness that nobody has measured meets no bar.
    pub fn misses(&self, report: &LevelReport) -> Vec<Miss> {
        let likeness = report.likeness.as_ref();
        let least = [
            ("likeness.psnr", likeness.map(|likeness| likeness.psnr), self.min_psnr),
            ("likeness.silhouette_iou", likeness.map(|likeness| likeness.silhouette_iou), self.min_silhouette_iou),
        ];
        let too_low = least.into_iter().filter(|(_, value, bar)| *bar > 0.0 && value.is_none_or(|value| value < *bar));
        let deviation = report.deviation.percentile_95;
        let is_too_far = self.max_deviation < 1.0 && (deviation.is_nan() || deviation > self.max_deviation);
        let too_far = is_too_far.then_some(("deviation.percentile_95", Some(deviation), self.max_deviation));
        too_low.chain(too_far).map(|(figure, value, bar)| Miss { figure: figure.to_owned(), value, bar }).collect()
    }
}

/// A bar that a level misses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Miss {
    /// The field of the level's report that was checked.
    pub figure: String,
    /// Its value; null if the report has none.
    pub value: Option<f32>,
    /// What was asked for.
    pub bar: f32,
}

impl std::fmt::Display for Miss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { figure, value, bar } = self;
        match value {
            Some(value) => write!(f, "{figure} is {value}, the bar is {bar}"),
            None => write!(f, "{figure} is unknown, the bar is {bar}"),
        }
    }
}

/// What is asked of the levels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GateParams {
    /// PSNR in dB below which the report says that a level does not look like its source.
    pub warn_below: f32,
    /// Bars of each level.
    pub bars: Bars,
    /// What happens to a level that misses one.
    pub on_miss: OnMiss,
}

impl GateParams {
    pub(super) fn new(settings: &BakeSettings) -> Self {
        Self { warn_below: settings.warn_below, bars: Bars::of(settings), on_miss: settings.on_miss }
    }

    /// What is wrong with a level, in words; `None` if nothing is, or if nobody has looked.
    pub(super) fn warning(&self, report: &LevelReport) -> Option<String> {
        let unlike = report.likeness.as_ref()?.warning(report.level, self.warn_below);
        let misses = self.missed(report).map(|missed| format!("LOD{}: {missed}", report.level));
        let all: Vec<String> = unlike.into_iter().chain(misses).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }

    /// The bars that a level misses, in words; `None` if it meets all.
    pub(super) fn missed(&self, report: &LevelReport) -> Option<String> {
        let missed: Vec<String> = self.bars.misses(report).iter().map(Miss::to_string).collect();
        (!missed.is_empty()).then(|| missed.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(psnr: Option<f64>) -> LevelReport {
        let likeness = psnr.map(|psnr| serde_json::json!({"psnr": psnr, "psnr_lit": 9.0, "silhouette_iou": 0.5}));
        let report = serde_json::json!({
            "level": 2, "budget": 9, "faces": 8, "candidate": "source", "error": 0.25, "charts": 1, "fill": 0.5,
            "stretch": 1.0, "worst_stretch": 1.0, "likeness": likeness,
            "deviation": {"mean": 0.125, "percentile_95": 0.25, "max": 0.5},
            "topology": {"components": 1, "euler_characteristic": 2, "boundary_edges": 0, "self_intersecting": 0},
        });
        serde_json::from_value(report).expect("a report")
    }

    fn figures((min_psnr, min_silhouette_iou, max_deviation): (f32, f32, f32), psnr: Option<f64>) -> Vec<String> {
        let bars = Bars { min_psnr, min_silhouette_iou, max_deviation };
        bars.misses(&report(psnr)).into_iter().map(|miss| miss.figure).collect()
    }

    #[test]
    fn each_bar_is_held_against_its_figure() {
        assert!(figures((0.0, 0.0, 1.0), None).is_empty(), "nothing is asked for");
        assert!(figures((20.0, 0.5, 0.25), Some(20.0)).is_empty(), "just met");
        let all = ["likeness.psnr", "likeness.silhouette_iou", "deviation.percentile_95"];
        assert_eq!(figures((20.5, 0.75, 0.2), Some(20.0)), all);
        assert_eq!(figures((1.0, 0.0, 1.0), None), ["likeness.psnr"], "nobody has looked");
    }

    #[test]
    fn a_warning_says_what_was_found() {
        let bars = Bars { min_psnr: 20.0, min_silhouette_iou: 0.0, max_deviation: 1.0 };
        let gate = GateParams { warn_below: 0.0, bars, on_miss: OnMiss::Warn };
        let warning = gate.warning(&report(Some(18.5)));
        assert_eq!(warning.as_deref(), Some("LOD2: likeness.psnr is 18.5, the bar is 20"));
        assert_eq!(gate.warning(&report(None)), None);
    }
}
