//! The measure agrees with the benchmark that `docs/results.md` describes, on one level of the octopus.
//!
//! Levels change with the pipeline, so the level and the benchmark's figures for it are files.

use std::fs;
use std::path::Path;

use serde_json::Value;
use simpliguard::data::Model;
use simpliguard::gltf::{ImportLimits, import};
use simpliguard::{NoResources, Source};
use simpliguard_eval::compare::{Comparison, Options, compare};

/// A figure that both measure.
struct Figure {
    /// Where the benchmark has it.
    pointer: &'static str,
    ours: fn(&Comparison) -> Option<f64>,
    /// Largest difference: one and a half times that of the two when the benchmark's figures were taken.
    tolerance: f64,
}

const FIGURES: [Figure; 9] = [
    Figure { pointer: "/unlit/psnr", ours: |c| Some(c.unlit.psnr), tolerance: 0.42 },
    Figure { pointer: "/unlit/psnr_fg", ours: |c| Some(c.unlit.psnr_foreground), tolerance: 0.42 },
    Figure { pointer: "/lit/psnr", ours: |c| Some(c.lit.psnr), tolerance: 0.28 },
    Figure { pointer: "/unlit/ssim", ours: |c| Some(c.unlit.ssim), tolerance: 0.0043 },
    Figure { pointer: "/unlit/flip", ours: |c| Some(c.unlit.flip), tolerance: 0.0034 },
    Figure { pointer: "/silhouette_iou", ours: |c| Some(c.silhouette_iou), tolerance: 0.000_01 },
    Figure { pointer: "/iou3d", ours: |c| c.iou_3d, tolerance: 0.000_01 },
    Figure { pointer: "/chamfer_pct", ours: |c| c.distances.map(|d| 100.0 * d.chamfer), tolerance: 0.002 },
    Figure { pointer: "/hausdorff_pct", ours: |c| c.distances.map(|d| 100.0 * d.hausdorff), tolerance: 0.2 },
];

/// Views of the benchmark's figures.
const VIEWS: usize = 20;

fn model(path: &str) -> Model {
    let bytes = fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).expect(path);
    let source = Source { name: path, bytes: &bytes, resources: &NoResources };
    import(&source, &ImportLimits::default()).expect(path)
}

#[test]
fn the_figures_are_those_of_the_benchmark() {
    let benchmark: Value = serde_json::from_str(include_str!("data/octopus_400.json")).expect("JSON");
    let (source, level) = (model("../../assets/octopus.glb"), model("tests/data/octopus_400.glb"));
    assert_eq!(benchmark["source_faces"], source.surface.triangles.len(), "the figures are of another octopus");
    let options = Options { views: VIEWS, ..Options::default() };
    let found = compare(&source, &[&level], &options)[0];
    let differences: Vec<String> = FIGURES.iter().filter_map(|figure| figure.beyond(&found, &benchmark)).collect();
    assert!(differences.is_empty(), "{}", differences.join("\n"));
}

impl Figure {
    /// Both values, if they differ by more than the tolerance.
    fn beyond(&self, found: &Comparison, benchmark: &Value) -> Option<String> {
        let Self { pointer, ours, tolerance } = self;
        let theirs = benchmark.pointer(pointer).and_then(Value::as_f64).expect(pointer);
        let ours = ours(found).expect(pointer);
        let difference = (ours - theirs).abs();
        let is_beyond = difference.is_nan() || difference > *tolerance;
        is_beyond.then(|| format!("{pointer}: {ours} and {theirs} differ by {difference}, more than {tolerance}"))
    }
}
