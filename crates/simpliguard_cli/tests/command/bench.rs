//! `simpliguard bench`.

use crate::bake::QUICK;
use crate::folder::{Folder, triangle};

#[test]
fn each_number_of_threads_is_measured_beside_meshoptimizer() {
    let folder = Folder::new();
    let bench = |flags: &[&str]| {
        folder.run(&[&["bench", "--triangles", "3000", "--faces", "60", "--threads", "1,2"], flags, &QUICK].concat())
    };
    let run = bench(&["--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let document = run.json();
    assert_eq!((&document["model"], &document["faces"]), (&"a bumpy torus".into(), &3042.into()));
    let runs = document["runs"].as_array().expect("runs");
    assert_eq!(runs.iter().map(|run| run["threads"].as_u64()).collect::<Vec<_>>(), [Some(1), Some(2)]);
    for run in runs {
        let number = |field: &str| run[field].as_f64().expect("a number");
        assert!((number("ratio") - number("seconds") / number("meshopt")).abs() < 1e-6 * number("ratio"));
        assert!(
            run["stages"].as_array().is_some_and(|stages| stages.iter().any(|stage| stage[0] == "simplify")),
            "{run}"
        );
    }
    let text = bench(&[]).stdout;
    let first = |line: &str| line.split("  ").next().unwrap_or_default().to_owned();
    let titles: Vec<String> = text.lines().skip(3).map(first).collect();
    assert!(titles.starts_with(&["threads".into(), "import".into()]), "{text}");
    assert!(titles.ends_with(&["whole bake".into(), "meshoptimizer".into(), "ratio".into()]), "{text}");
}

#[test]
fn a_model_without_levels_is_no_benchmark() {
    let folder = Folder::new().with("small.glb", triangle());
    let run = folder.run(&["bench", "small.glb"]);
    assert_eq!(run.code, 2);
    run.says("small.glb: no level is baked for it");
    assert_eq!(folder.run(&["bench", "--triangles", "5"]).code, 2);
}
