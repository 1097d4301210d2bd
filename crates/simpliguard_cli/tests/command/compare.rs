//! Comparison of levels with their source.

use crate::bake::quick;
use crate::folder::{Folder, sphere, triangle};

const FEW: [&str; 2] = ["--views", "2"];

#[test]
fn levels_of_both_kinds_of_output_are_compared_alike() {
    let folder = Folder::new().with("ball.glb", sphere(24));
    let baked = quick(&folder, &["ball.glb", "--faces", "100,400", "--split-levels"]);
    assert_eq!(baked.code, 0, "{}", baked.stderr);
    let compare = |files: &[&str]| {
        let run = folder.run(&[&["compare", "--json"], files, &FEW].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        run.json()
    };
    let split = compare(&["ball.glb", "lods/ball_100.glb", "lods/ball_400.glb"]);
    assert_eq!((&split["source"], &split["faces"], &split["views"]), (&"ball.glb".into(), &1128.into(), &2.into()));
    let figure = |document: &serde_json::Value, level: usize, path: &str| {
        document["levels"][level].pointer(path).and_then(serde_json::Value::as_f64).expect(path)
    };
    for better in ["/unlit/psnr", "/lit/psnr_foreground", "/silhouette_iou", "/iou_3d"] {
        assert!(figure(&split, 0, better) < figure(&split, 1, better), "{better}: {split}");
    }
    for worse in ["/lit/flip", "/distances/chamfer", "/distances/hausdorff"] {
        assert!(figure(&split, 0, worse) > figure(&split, 1, worse), "{worse}: {split}");
    }
    for whole in [compare(&["ball.glb", "lods/ball.glb"]), compare(&["lods/ball.glb"])] {
        for (level, number) in [(0, 1), (1, 2)] {
            assert_eq!(whole["levels"][level]["level"], number);
            for same in ["/unlit/psnr", "/silhouette_iou", "/distances/chamfer"] {
                assert!((figure(&whole, level, same) - figure(&split, level, same)).abs() < 1e-6, "{same}");
            }
        }
    }
}

#[test]
fn the_table_has_a_row_for_each_level() {
    let folder = Folder::new().with("ball.glb", sphere(12)).with("one.glb", triangle());
    let run = folder.run(&[&["compare", "ball.glb", "ball.glb", "one.glb", "--motion"], &FEW[..]].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
    let lines: Vec<Vec<&str>> = run.stdout.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines.len(), 3, "{}", run.stdout);
    assert_eq!(lines[1][..7], ["ball.glb", "276", "100.00", "100.00", "100.00", "1.000", "0.000"]);
    assert_eq!(lines[1][7..], ["100.00", "100.00", "0.000", "0.00", "-", "-", "-", "-", "-"]);
    assert_eq!(lines[2][..2], ["one.glb", "1"]);
}

#[test]
fn what_cannot_be_compared_is_named() {
    let folder = Folder::new().with("ball.glb", sphere(12)).with("broken.glb", "glTF");
    for (args, message) in [
        (&["ball.glb"][..], "ball.glb: it holds no levels to compare; name the files of its levels"),
        (&["ball.glb", "none.glb"], "none.glb: import: cannot read the file: there is no such file; check the path"),
        (&["ball.glb", "broken.glb"], "broken.glb: import: "),
        (&["ball.glb", "ball.glb", "--views", "0"], "--views"),
        (&["ball.glb", "ball.glb", "--lpips-weights", "none"], "none: it cannot be read: "),
        (&["ball.glb", "ball.glb", "--lpips-weights", "broken.glb"], "broken.glb: it is no safetensors file: "),
        (&[], "required"),
    ] {
        let run = folder.run(&[&["compare"], args].concat());
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        run.says(message);
    }
}
