//! `inspect` on a model.

use crate::bake::{QUICK, quick};
use crate::folder::{Folder, sphere, triangle};

#[test]
fn a_model_is_described_with_its_settings_and_their_origins() {
    let folder = Folder::new()
        .with("assets/a.glb", sphere(8))
        .with("config/simpliguard.ron", "(rules: [(glob: \"a.glb\", settings: (texture_size: 256))])");
    let run = folder.run(&["inspect", "assets/a.glb", "--faces", "40", "--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let document = run.json();
    let contents = &document["contents"];
    assert_eq!((&contents["triangles"], &contents["nodes"]), (&120.into(), &1.into()));
    assert_eq!(contents["meshes"][0]["primitives"], 1);
    let setting = |name: &str| {
        let all = document["settings"].as_array().expect("settings");
        let found = all.iter().find(|setting| setting["name"] == name).expect("the setting");
        (found["value"].as_str().expect("a value").to_owned(), found["origin"].as_str().expect("an origin").to_owned())
    };
    assert_eq!(setting("texture_size"), ("256".into(), "config/simpliguard.ron, rule \"a.glb\"".into()));
    assert_eq!(setting("faces"), ("[40]".into(), "command line".into()));
    assert_eq!((&document["result"]["cached"], &document["levels"]), (&false.into(), &serde_json::json!([])));
    let text = folder.run(&["inspect", "assets/a.glb"]).stdout;
    for part in ["120 triangles", "texture_size", "rule \"a.glb\"", "not in the cache of this machine"] {
        assert!(text.contains(part), "'{part}' is not in\n{text}");
    }
}

#[test]
fn a_result_in_the_cache_and_the_levels_of_an_output_are_listed() {
    let folder = Folder::new().with("ball.glb", sphere(16));
    let settings = ["--faces", "50,100", "--set", "texture_size=64"];
    let quickly = [&settings[..], &["--quality", "draft", "--set", "views=8", "--set", "view_size=128"]].concat();
    let quickly = [&quickly[..], &["--set", "candidates=source"]].concat();
    assert_eq!(quick(&folder, &["ball.glb", "--faces", "50,100"]).code, 0);
    let source = folder.run(&[&["inspect", "ball.glb", "--json"], &quickly[..]].concat()).json();
    assert_eq!(source["result"]["cached"], true, "{source}");
    assert_eq!(source["result"]["levels"][1]["budget"], 100);
    assert_eq!(source["result"]["key"].as_str().map(str::len), Some(64));

    let run = folder.run(&["inspect", "lods/ball.glb", "--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let output = run.json();
    let bytes = |level: usize| output["levels"][level]["bytes"].as_u64().expect("a size");
    assert!(bytes(0) > 50 * 6 && bytes(1) > bytes(0), "{output}");
    let mipmapped = 4 * (64 * 64 + 32 * 32 + 16 * 16 + 8 * 8 + 4 * 4 + 2 * 2 + 1);
    let number = |name: &str| output["levels"][0][name].as_u64().expect("a number");
    let found = number("texture_memory");
    assert!((0..4).any(|textures| textures * mipmapped == found), "{found}");
    assert!(number("draw_calls") == 1 && number("mesh_memory") > 50 * 6, "{output}");
    let source = output["source"]["mesh_memory"].as_u64().expect("a number");
    assert!(source > 2 * number("mesh_memory") && output["source"]["draw_calls"] == 1, "{output}");
    let text = folder.run(&["inspect", "lods/ball.glb"]).stdout;
    assert!(text.lines().any(|line| line.split_whitespace().take(2).eq(["LOD2", "100"])), "{text}");
    assert!(text.contains("memory on the GPU") && text.lines().any(|line| line.starts_with("source ")), "{text}");
}

/// The rows of a document that have a content: stage, level, and if the cache has them.
fn stored(document: &serde_json::Value) -> Vec<(String, Option<u64>, bool)> {
    let rows = document["stages"].as_array().expect("stages");
    let of = |row: &serde_json::Value| {
        let known = row["key"].as_str().map_or(row["needs"].is_string(), |key| key.len() == 64);
        assert!(known, "{row}");
        let stage = row["stage"].as_str().expect("a stage");
        (stage.to_owned(), row["level"].as_u64(), row["cached"].as_bool().expect("a flag"))
    };
    rows.iter().filter(|row| row["content"].is_string()).map(of).collect()
}

#[test]
fn stages_are_told_with_their_keys_and_whether_they_are_cached() {
    let folder = Folder::new().with("ball.glb", sphere(16));
    let settings = ["--faces", "50,100", "--set", "refine_steps=3"];
    let baked = [&["ball.glb"], &settings[..]].concat();
    let settings = [&settings[..], &QUICK].concat();
    let inspect =
        |more: &[&str]| folder.run(&[&["inspect", "ball.glb", "--json"], &settings[..], more].concat()).json();
    let before = inspect(&[]);
    assert!(stored(&before).iter().all(|(_, _, cached)| !cached), "{before}");
    let key = |document: &serde_json::Value, stage: &str| {
        let rows = document["stages"].as_array().expect("stages");
        rows.iter().rfind(|row| row["stage"] == stage).expect(stage)["key"].clone()
    };
    assert!(key(&before, "simplify").is_string() && key(&before, "refine").is_null(), "{before}");
    let text = folder.run(&[&["inspect", "ball.glb"], &settings[..]].concat()).stdout;
    assert!(text.contains("needs simplify") && text.contains("not stored"), "{text}");

    assert_eq!(quick(&folder, &baked).code, 0);
    let after = inspect(&[]);
    let of = |stage: &str, level| (stage.to_owned(), level, true);
    let expected = [
        of("simplify", None),
        of("simplify", None),
        of("unwrap", Some(1)),
        of("unwrap", Some(2)),
        of("refine", Some(1)),
        of("refine", Some(2)),
        of("export", None),
    ];
    assert_eq!(stored(&after), expected, "{after}");
    assert_eq!((key(&before, "simplify"), &key(&after, "export")), (key(&after, "simplify"), &after["result"]["key"]));

    // A changed parameter of a late stage leaves the earlier results.
    let later = inspect(&["--set", "refine_steps=5"]);
    let cached = |(stage, _, cached): &(String, Option<u64>, bool)| *cached != ["refine", "export"].contains(&&**stage);
    assert!(stored(&later).iter().all(cached), "{later}");
    // A file that gets no levels has no stages.
    assert_eq!(inspect(&["--set", "enabled=false"])["stages"], serde_json::json!([]));
}

#[test]
fn a_file_or_the_pipeline_is_inspected() {
    let folder = Folder::new().with("a.glb", triangle()).with("b.glb", "glTF");
    assert_eq!(folder.run(&["inspect"]).code, 2);
    assert_eq!(folder.run(&["inspect", "a.glb", "--pipeline"]).code, 2);
    let run = folder.run(&["inspect", "b.glb"]);
    assert_eq!(run.code, 2);
    run.says("b.glb: import: ");
}
