//! The quality gate.

use crate::bake::quick;
use crate::folder::{Folder, Run, sphere, triangle};

#[test]
fn a_level_below_a_bar_is_named_and_its_file_is_written() {
    let folder = Folder::new().with("in/ball.glb", sphere(16)).with("in/small.glb", triangle());
    let bake = |bars: &[&str]| quick(&folder, &[&["in", "--json", "--faces", "50"], bars].concat());
    let open = bake(&["--gate", "--min-psnr", "1", "--min-silhouette-iou", "0.1", "--max-deviation", "0.9"]);
    assert_eq!(open.code, 0, "{}", open.stderr);
    assert_eq!(open.json()["assets"][0]["gate"], serde_json::json!([]));
    for bars in [["--min-psnr", "99"], ["--min-silhouette-iou", "0.999999"], ["--max-deviation", "0.000001"]] {
        let run = bake(&[&["--gate"], &bars[..]].concat());
        assert_eq!(run.code, 3, "{bars:?}: {}", run.stderr);
        run.says("error: gate: in/ball.glb: LOD1: ");
        run.says("2 written, 2 of them from the cache; 0 failed; 1 below the bars of the gate");
        let missed = &run.json()["assets"][0]["gate"];
        let bar: f64 = bars[1].parse().expect("a number");
        assert_eq!((missed.as_array().map(Vec::len), &missed[0]["level"]), (Some(1), &1.into()));
        assert!((missed[0]["bar"].as_f64().expect("a bar") - bar).abs() < 1e-5 && missed[0]["value"].is_f64());
        assert!(folder.path("lods/ball.glb").exists());
    }
    // `warn_below` is a bar of its own, and decides nothing without the gate.
    let strict = ["--set", "warn_below=60"];
    assert_eq!(bake(&strict).code, 0);
    assert!(bake(&strict).json()["assets"][0]["gate"].is_null());
    assert_eq!(bake(&[&strict[..], &["--gate"]].concat()).code, 3);
}

#[test]
fn a_model_that_fails_counts_before_the_gate() {
    let folder = Folder::new().with("in/ball.glb", sphere(16)).with("in/broken.glb", "glTF");
    let run = quick(&folder, &["in", "--faces", "50", "--gate", "--min-psnr", "99"]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    run.says("error: gate: in/ball.glb: LOD1: likeness.psnr is ");
    assert_eq!(quick(&folder, &["in", "--min-psnr", "99"]).code, 2);
}

/// A bake to 50 and 400 faces with bars in the project's settings, and the notes about it.
fn with_bars(bars: &str, flags: &[&str]) -> (Run, String) {
    let project = format!("(rules: [(glob: \"in/*\", settings: {bars})])");
    let folder = Folder::new().with("in/ball.glb", sphere(32)).with("config/simpliguard.ron", project);
    let run = quick(&folder, &[&["in", "--json", "--faces", "50,400"], flags].concat());
    let notes = run.json()["assets"][0]["notes"].to_string();
    (run, notes)
}

#[test]
fn a_level_that_misses_a_bar_of_its_settings_is_told() {
    let (run, notes) = with_bars("(min_silhouette_iou: 1.0)", &[]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(notes.contains("LOD1: likeness.silhouette_iou is "), "{notes}");
    assert_eq!(with_bars("(min_silhouette_iou: 1.0)", &["--gate"]).0.code, 3);
}

#[test]
fn a_level_that_misses_a_bar_has_its_budget_raised() {
    let faces = |run: &Run, level: usize| run.json()["assets"][0]["levels"][level]["faces"].as_u64().expect("a count");
    let (run, notes) = with_bars("(min_psnr: 60.0, on_miss: RaiseBudget)", &[]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(notes.contains("LOD1 missed its bars at 50 faces: it has 200 now, and misses them still"), "{notes}");
    assert!(notes.contains("LOD2 missed its bars at 400 faces: it has 1600 now, "), "{notes}");
    assert!((100..=200).contains(&faces(&run, 0)) && (800..=1600).contains(&faces(&run, 1)), "{}", run.stdout);

    let (free, _) = with_bars("()", &[]);
    let deviation = &free.json()["assets"][0]["levels"][0]["deviation"]["percentile_95"];
    let bar = deviation.as_f64().expect("a deviation") * 0.8;
    let (run, notes) = with_bars(&format!("(max_deviation: {bar:.6}, on_miss: RaiseBudget)"), &["--gate"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        notes.contains("LOD1 missed its bars at 50 faces: it has ") && notes.contains(" now, to meet them"),
        "{notes}"
    );
    assert!(!notes.contains("LOD2"), "{notes}");
    assert_eq!(faces(&run, 1), faces(&free, 1), "the other level is as it was");
}

#[test]
fn a_level_that_misses_a_bar_fails_its_model_if_asked() {
    let (run, _) = with_bars("(min_psnr: 60.0, on_miss: Fail)", &[]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    run.says("in/ball.glb: maps: LOD1: likeness.psnr is ");
    run.says("raise its `faces`, lower the bar, or set `on_miss: Warn`");
    assert_eq!(run.json()["assets"][0]["status"], "failed");
    assert_eq!(with_bars("(min_psnr: 1.0, on_miss: Fail)", &[]).0.code, 0);
}
