//! The command's answers to wrong requests and unusable files.

use simpliguard::{PIPELINE_VERSION, STAGES};

use crate::folder::{Folder, sphere, triangle};

#[test]
fn a_missing_file_fails_alone() {
    let folder = Folder::new();
    let run = folder.bake(&["nothing.glb", "--json"]);
    assert_eq!(run.code, 1);
    let error = run.json()["assets"][0]["error"].as_str().map(str::to_owned);
    assert_eq!(
        error.as_deref(),
        Some("nothing.glb: import: cannot read the file: there is no such file; check the path")
    );
}

#[test]
fn a_wrong_extension_is_named() {
    let folder = Folder::new().with("chair.obj", "v 0 0 0");
    let run = folder.bake(&["chair.obj"]);
    assert_eq!(run.code, 1);
    run.says("chair.obj: import: its name does not end in .glb or .gltf; convert it to glTF first");
}

#[test]
fn a_truncated_file_is_named() {
    let folder = Folder::new().with("a.glb", &triangle()[..100]).with("b.gltf", "{\"asset\":").with("c.glb", "");
    let run = folder.bake(&["a.glb", "b.gltf", "c.glb"]);
    assert_eq!(run.code, 1);
    run.says("a.glb: import: the file is truncated: it should hold 532 bytes");
    run.says("b.gltf: import: its JSON is broken");
    run.says("c.glb: import: not a glTF file: it is empty");
    assert!(!folder.path("lods").exists());
}

#[test]
fn a_typo_in_meta_fails_that_model_with_its_place() {
    let meta = "(\n  meta_format_version: \"1.0\",\n  asset: Process(\n    processor: \"SimpliguardProcess\",\n    \
                settings: (textur_size: 512),\n  ),\n)";
    let folder = Folder::new().with("a.glb", triangle()).with("a.glb.meta", meta);
    let run = folder.bake(&["a.glb"]);
    assert_eq!(run.code, 1);
    run.says("a.glb.meta:5:16: unknown field 'textur_size'; did you mean 'texture_size'?");
}

#[test]
fn a_typo_in_the_project_file_is_a_usage_error() {
    let folder = Folder::new()
        .with("assets/a.glb", triangle())
        .with("config/simpliguard.ron", "(\n  defaults: (quality: Drft),\n)");
    let run = folder.bake(&["assets"]);
    assert_eq!(run.code, 2);
    run.says("config/simpliguard.ron:2:");
    run.says("quality: expected Draft, Standard or Best");
}

#[test]
fn conflicting_outputs_are_named_before_anything_is_baked() {
    let folder = Folder::new().with("x/a.glb", triangle()).with("y/a.gltf", "{}").with("b.glb", triangle());
    let run = folder.bake(&["b.glb", "x/a.glb", "y/a.gltf"]);
    assert_eq!(run.code, 2);
    run.says("x/a.glb and y/a.gltf would both be written to lods/a.glb");
    assert!(!folder.path("lods").exists());
    // A level of one model against another model.
    let folder = Folder::new().with("a.glb", triangle()).with("a_1000.glb", triangle());
    let run = folder.bake(&["a.glb", "a_1000.glb", "--split-levels"]);
    assert_eq!(run.code, 2);
    run.says("a.glb and a_1000.glb would both be written to lods/a_1000.glb");
}

#[test]
fn an_output_folder_that_cannot_be_is_found_before_the_bake() {
    let folder = Folder::new().with("a.glb", sphere(30)).with("occupied", "a file");
    let run = folder.bake(&["a.glb", "--output", "occupied", "--json"]);
    assert_eq!(run.code, 1);
    run.says("a.glb: export: cannot write occupied/a.glb");
    assert!(!run.stderr.contains("import (0 %)"), "{}", run.stderr);
}

#[test]
fn inputs_are_never_overwritten() {
    let folder = Folder::new().with("in/a.glb", triangle());
    let run = folder.bake(&["in", "--output", "in"]);
    assert_eq!(run.code, 2);
    run.says("would overwrite the input in/a.glb");
}

#[test]
fn bad_flags_are_explained() {
    let folder = Folder::new().with("a.glb", triangle()).with("empty/readme.txt", "").with("s.ron", "(views: 5)");
    for (args, message) in [
        (&["a.glb", "--set", "texture_size=1000"][..], "expected a power of two from 64 to 4096"),
        (&["a.glb", "--set", "texture-sise=64"], "did you mean 'texture_size'?"),
        (&["a.glb", "--set", "views"], "expected FIELD=VALUE"),
        (&["a.glb", "--faces", "many"], "expected whole numbers with commas between"),
        (&["a.glb", "--quality", "good"], "draft, standard, best"),
        (&["a.glb", "--settings", "s.ron"], "s.ron:1:"),
        (&["a.glb", "--settings", "none.ron"], "cannot read none.ron"),
        (&["a.glb", "--profile", "vr"], "no profile named 'vr'"),
        (&["a.glb", "--project", "none"], "there is no such folder"),
        (&["a.glb", "--device", "cpu"], "unexpected argument"),
        (&["a.glb", "--backend", "tpu"], "invalid value"),
        (&["a.glb", "--threads", "0"], "--threads"),
        (&["empty"], "there is no .glb or .gltf file below this folder"),
        (&[], "required"),
    ] {
        let run = folder.bake(args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        run.says(message);
    }
    let run = folder.bake(&["empty", "--json"]);
    assert_eq!(run.code, 2);
    assert_eq!(run.json()["error"], "empty: there is no .glb or .gltf file below this folder");
    assert_eq!(run.json()["assets"].as_array().map(Vec::len), Some(0));
    assert!(!folder.path("lods").exists());
}

#[test]
fn settings_prints_a_reference_that_can_be_read_back() {
    let folder = Folder::new().with("a.glb", triangle());
    let reference = folder.run(&["settings"]);
    assert_eq!(reference.code, 0);
    std::fs::write(folder.path("reference.ron"), &reference.stdout).expect("writes");
    let shown = folder.run(&["settings", "show", "a.glb", "--settings", "reference.ron"]);
    assert_eq!(shown.code, 0, "{}", shown.stderr);
    assert!(shown.stdout.lines().all(|line| "()".contains(line) || line.ends_with("// reference.ron")));
}

#[test]
fn settings_show_tells_where_values_come_from() {
    let meta = "(meta_format_version: \"1.0\", asset: Process(processor: \"bevy_simpliguard::SimpliguardProcess\", \
                settings: (gutter: 2)))";
    let folder = Folder::new().with("assets/props/a.glb", triangle()).with("assets/props/a.glb.meta", meta).with(
        "config/simpliguard.ron",
        "(defaults: (texture_size: 512, gutter: 8), rules: [(glob: \"props/**\", settings: (view_size: 256))], \
             profiles: {\"vr\": (quality: Best)})",
    );
    let run = folder.run(&["settings", "show", "assets/props/a.glb", "--profile", "vr", "--faces", "9,7"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    for line in [
        "texture_size: 512, // config/simpliguard.ron, defaults",
        "gutter: 2, // assets/props/a.glb.meta",
        "view_size: 256, // config/simpliguard.ron, rule \"props/**\"",
        "quality: Best, // config/simpliguard.ron, profile \"vr\"",
        "views: 80, // quality Best",
        "faces: [7, 9], // command line",
        "watertight: false, // built in",
    ] {
        let squeezed = run.stdout.lines().map(|l| l.split_whitespace().collect::<Vec<_>>().join(" "));
        assert!(squeezed.into_iter().any(|l| l == line), "no line '{line}' in\n{}", run.stdout);
    }
}

#[test]
fn inspect_prints_the_stages_in_their_order() {
    let folder = Folder::new();
    let run = folder.run(&["inspect", "--pipeline"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let names: Vec<&str> = run.stdout.lines().filter_map(|line| line.split_whitespace().next()).collect();
    let stages: Vec<String> = STAGES.iter().map(|stage| stage.id.to_string()).collect();
    assert_eq!(names[0], "stage");
    assert_eq!(names[1..], stages[..]);
    let document = folder.run(&["inspect", "--pipeline", "--json"]).json();
    assert_eq!((&document["version"], &document["pipeline_version"]), (&1.into(), &PIPELINE_VERSION.into()));
    for (shown, stage) in document["stages"].as_array().expect("stages").iter().zip(&STAGES) {
        assert_eq!((&shown["id"], &shown["purpose"]), (&stage.id.to_string().into(), &stage.purpose.into()));
        assert_eq!((&shown["weight"], &shown["per_level"]), (&stage.weight.into(), &stage.per_level.into()));
        assert!(run.stdout.contains(&format!("{} %", stage.weight)) && run.stdout.contains(stage.purpose));
    }
    assert_eq!(document["stages"].as_array().map(Vec::len), Some(STAGES.len()));
    assert_eq!(folder.run(&["inspect"]).code, 2);
}
