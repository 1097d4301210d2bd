//! The quality gate.

use crate::bake::quick;
use crate::folder::{Folder, sphere, triangle};

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
