//! The quality gate of `bake --gate`: bars that every level must meet, for CI.

use serde::Serialize;
use simpliguard::settings::BakeSettings;
use simpliguard::{Bars, LevelReport, Miss, Report};

use crate::args::GateArgs;

/// A level that misses a bar.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct LevelMiss {
    /// The object of a scene whose level it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    object: Option<String>,
    /// Its number, from 1, the smallest.
    level: u32,
    #[serde(flatten)]
    miss: Miss,
}

impl LevelMiss {
    /// The message about an asset.
    pub(crate) fn line(&self, asset: &str) -> String {
        let Self { object, level, miss } = self;
        let object = object.as_ref().map_or_else(String::new, |object| format!("{object}: "));
        format!("gate: {asset}: {object}LOD{level}: {miss}; raise its `faces` or lower the bar")
    }
}

impl GateArgs {
    /// The bars that levels miss; `None` without `--gate`. Of a bar of the settings and one of the command line, the
    /// stricter one counts.
    pub(crate) fn check(&self, report: &Report, settings: &BakeSettings) -> Option<Vec<LevelMiss>> {
        let own = Bars::of(settings);
        let bars = Bars {
            min_psnr: self.min_psnr.unwrap_or(0.0).max(own.min_psnr).max(settings.warn_below),
            min_silhouette_iou: self.min_silhouette_iou.unwrap_or(0.0).max(own.min_silhouette_iou),
            max_deviation: self.max_deviation.unwrap_or(1.0).min(own.max_deviation),
        };
        let whole = report.levels.iter().map(|level| (None, level));
        let objects =
            report.objects.iter().flat_map(|object| object.levels.iter().map(|level| (Some(&object.name), level)));
        let of_level = |(object, report): (Option<&String>, &LevelReport)| {
            let (object, level) = (object.cloned(), report.level);
            let missed = bars.misses(report).into_iter();
            missed.map(move |miss| LevelMiss { object: object.clone(), level, miss }).collect::<Vec<_>>()
        };
        self.gate.then(|| whole.chain(objects).flat_map(of_level).collect())
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

    fn figures(args: &GateArgs, psnr: Option<f64>) -> Vec<String> {
        let missed = args.check(&report(psnr), &BakeSettings::default()).expect("checked");
        missed.into_iter().map(|missed| missed.miss.figure).collect()
    }

    #[test]
    fn each_bar_is_held_against_its_figure() {
        let gate = GateArgs { gate: true, ..GateArgs::default() };
        assert_eq!(GateArgs::default().check(&report(Some(1.0)), &BakeSettings::default()), None);
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
    fn of_two_bars_the_stricter_one_counts() {
        let settings = BakeSettings { min_psnr: 19.0, max_deviation: 0.2, ..BakeSettings::default() };
        let figures = |args: GateArgs| {
            let missed = args.check(&report(Some(18.5)), &settings).expect("checked");
            missed.into_iter().map(|missed| missed.miss.bar).collect::<Vec<f32>>()
        };
        assert_eq!(figures(GateArgs { gate: true, ..GateArgs::default() }), [19.0, 0.2]);
        let args = GateArgs { gate: true, min_psnr: Some(20.0), max_deviation: Some(0.5), min_silhouette_iou: None };
        assert_eq!(figures(args), [20.0, 0.2]);
    }

    #[test]
    fn a_miss_says_what_was_found() {
        let gate = GateArgs { gate: true, min_psnr: Some(20.0), ..GateArgs::default() };
        let missed = gate.check(&report(Some(18.5)), &BakeSettings::default()).expect("checked");
        let line = missed[0].line("a.glb");
        assert!(line.starts_with("gate: a.glb: LOD2: likeness.psnr is 18.5, the bar is 20;"), "{line}");
        let mut scene = report(Some(18.5));
        let levels = std::mem::take(&mut scene.levels);
        scene.objects.push(ObjectReport {
            name: "Chair".into(),
            instances: 3,
            source_faces: 99,
            levels,
            own_levels: Vec::new(),
        });
        let line = gate.check(&scene, &BakeSettings::default()).expect("checked")[0].line("a.glb");
        assert!(line.starts_with("gate: a.glb: Chair: LOD2: likeness.psnr is 18.5"), "{line}");
    }
}
