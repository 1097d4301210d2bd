//! The quality gate of `bake --gate`: bars that every level must meet, for CI.

use serde::Serialize;
use simpliguard::{LevelReport, Report};

use crate::args::GateArgs;

/// A level that misses a bar.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Miss {
    /// The object of a scene whose level it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    object: Option<String>,
    /// Its number, from 1, the smallest.
    level: u32,
    /// The field of the level's report that was checked.
    figure: &'static str,
    /// Its value; null if the report has none.
    value: Option<f32>,
    bar: f32,
}

impl Miss {
    /// The message about an asset.
    pub(crate) fn line(&self, asset: &str) -> String {
        let Self { object, level, figure, value, bar } = self;
        let object = object.as_ref().map_or_else(String::new, |object| format!("{object}: "));
        let value = value.map_or("unknown".to_owned(), |value| value.to_string());
        format!(
            "gate: {asset}: {object}LOD{level}: {figure} is {value}, the bar is {bar}; raise its `faces` or lower the bar"
        )
    }
}

impl GateArgs {
    /// The bars that levels miss; `None` without `--gate`.
    pub(crate) fn check(&self, report: &Report, warn_below: f32) -> Option<Vec<Miss>> {
        let whole = report.levels.iter().map(|level| (None, level));
        let objects =
            report.objects.iter().flat_map(|object| object.levels.iter().map(|level| (Some(&object.name), level)));
        let check = |(object, level)| self.check_level(object, level, warn_below);
        self.gate.then(|| whole.chain(objects).flat_map(check).collect())
    }

    fn check_level(&self, object: Option<&String>, report: &LevelReport, warn_below: f32) -> Vec<Miss> {
        let likeness = report.likeness.as_ref();
        let psnr = self.min_psnr.map_or(warn_below, |bar| bar.max(warn_below));
        let at_least = [
            ("likeness.psnr", likeness.map(|likeness| likeness.psnr), Some(psnr)),
            ("likeness.silhouette_iou", likeness.map(|likeness| likeness.silhouette_iou), self.min_silhouette_iou),
        ];
        let missed = at_least.into_iter().filter_map(|(figure, value, bar)| {
            let bar = bar?;
            let is_met = value.is_some_and(|value| value >= bar);
            (!is_met).then(|| Miss { object: object.cloned(), level: report.level, figure, value, bar })
        });
        let deviation = report.deviation.percentile_95;
        let too_far = self.max_deviation.filter(|bar| deviation.is_nan() || deviation > *bar).map(|bar| Miss {
            object: object.cloned(),
            level: report.level,
            figure: "deviation.percentile_95",
            value: Some(deviation),
            bar,
        });
        missed.chain(too_far).collect()
    }
}

#[cfg(test)]
mod tests {
    use simpliguard::ObjectReport;

    use super::*;

    fn report(psnr: Option<f64>) -> Report {
        let likeness = psnr.map(|psnr| serde_json::json!({"psnr": psnr, "psnr_lit": 9.0, "silhouette_iou": 0.5}));
        let report = serde_json::json!({
            "level": 2, "budget": 9, "faces": 8, "candidate": "source", "error": 0.25, "charts": 1, "fill": 0.5,
            "stretch": 1.0, "worst_stretch": 1.0, "likeness": likeness,
            "deviation": {"mean": 0.125, "percentile_95": 0.25, "max": 0.5},
            "topology": {"components": 1, "euler_characteristic": 2, "boundary_edges": 0, "self_intersecting": 0},
        });
        let report = serde_json::json!({
            "status": "baked", "source_faces": 99, "levels": [report], "notes": [], "seconds": [],
        });
        serde_json::from_value(report).expect("a report")
    }

    fn figures(args: &GateArgs, psnr: Option<f64>) -> Vec<&'static str> {
        args.check(&report(psnr), 12.0).expect("checked").iter().map(|miss| miss.figure).collect()
    }

    #[test]
    fn each_bar_is_held_against_its_figure() {
        let gate = GateArgs { gate: true, ..GateArgs::default() };
        assert_eq!(GateArgs::default().check(&report(Some(1.0)), 12.0), None);
        assert!(figures(&gate, Some(12.0)).is_empty());
        assert_eq!(figures(&gate, Some(11.5)), ["likeness.psnr"]);
        assert_eq!(figures(&gate, None), ["likeness.psnr"]);
        let bars = |psnr, silhouette, deviation| GateArgs {
            gate: true,
            min_psnr: Some(psnr),
            min_silhouette_iou: Some(silhouette),
            max_deviation: Some(deviation),
        };
        assert!(figures(&bars(20.0, 0.5, 0.25), Some(20.0)).is_empty());
        let all = ["likeness.psnr", "likeness.silhouette_iou", "deviation.percentile_95"];
        assert_eq!(figures(&bars(20.5, 0.75, 0.2), Some(20.0)), all);
    }

    #[test]
    fn a_miss_says_what_was_found() {
        let gate = GateArgs { gate: true, min_psnr: Some(20.0), ..GateArgs::default() };
        let missed = gate.check(&report(Some(18.5)), 12.0).expect("checked");
        let line = missed[0].line("a.glb");
        assert!(line.starts_with("gate: a.glb: LOD2: likeness.psnr is 18.5, the bar is 20;"), "{line}");
        let mut scene = report(Some(18.5));
        let levels = std::mem::take(&mut scene.levels);
        scene.objects.push(ObjectReport { name: "Chair".into(), instances: 3, source_faces: 99, levels });
        let line = gate.check(&scene, 12.0).expect("checked")[0].line("a.glb");
        assert!(line.starts_with("gate: a.glb: Chair: LOD2: likeness.psnr is 18.5"), "{line}");
    }
}
