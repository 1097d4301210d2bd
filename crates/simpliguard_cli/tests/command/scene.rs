//! Scenes with levels for each object: how their levels are compared, listed and shown.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use crate::bake::QUICK;
use crate::folder::{Folder, Run, scene, sphere};

/// Two levels for each object, and one for all of them.
const SETTINGS: [&str; 6] = ["--faces", "40,80", "--set", "scope=objects", "--set", "whole=60"];
const NAMES: [&str; 3] = ["whole LOD1", "LOD1 of all objects", "LOD2 of all objects"];

fn run(folder: &Folder, args: &[&str]) -> Run {
    let run = folder.run(args);
    assert_eq!(run.code, 0, "{}", run.stderr);
    run
}

/// A folder with `scene.glb`, and `lods/scene.glb`, which is baked from it.
fn baked() -> Folder {
    let folder = Folder::new().with("scene.glb", scene());
    run(&folder, &[&["bake", "scene.glb"], &SETTINGS[..], &QUICK].concat());
    folder
}

fn names(levels: &Value) -> Vec<&str> {
    levels.as_array().expect("levels").iter().map(|level| level["name"].as_str().expect("a name")).collect()
}

#[test]
fn the_whole_picture_and_each_kind_of_object_are_compared() {
    let folder = baked();
    let compare = |files: &[&str]| run(&folder, &[&["compare", "--json", "--views", "2"], files].concat()).json();
    let found = compare(&["scene.glb", "lods/scene.glb"]);
    let rows = &found["levels"];
    assert_eq!(names(rows), [&NAMES[..], &["LOD1", "LOD2"]].concat());
    assert_eq!((&found["faces"], rows[0].get("object")), (&json!(2 * 276 + 48), None));
    let object = |row: usize| ["object", "instances", "source_faces", "level"].map(|field| rows[row][field].clone());
    assert_eq!(object(3), [json!("Ball"), json!(2), json!(276), json!(1)]);
    let number = |row: usize, path: &str| rows[row].pointer(path).and_then(Value::as_f64).expect("a number");
    let faces = |row: usize| number(row, "/faces");
    // What has no levels is shown as it is, and each ball at its place.
    assert_eq!([faces(1), faces(2)], [2.0 * faces(3) + 48.0, 2.0 * faces(4) + 48.0]);
    assert!(number(2, "/distances/hausdorff") < 0.05 && number(4, "/distances/hausdorff") < 0.1, "{found}");
    assert!(number(3, "/lit/psnr") < number(4, "/lit/psnr"), "{found}");
    // The output keeps its source, so it can be compared with itself.
    assert_eq!(compare(&["lods/scene.glb"])["levels"][4]["unlit"], rows[4]["unlit"]);
    assert_eq!(names(&compare(&["scene.glb", "lods/scene.glb", "--objects", "0"])["levels"]), NAMES);
    let text = run(&folder, &["compare", "scene.glb", "lods/scene.glb", "--views", "1"]).stdout;
    assert!(text.lines().any(|line| line.starts_with("lods/scene.glb, Ball (2 instances), LOD2 ")), "{text}");
}

#[test]
fn objects_of_another_source_are_not_compared() {
    let folder = baked().with("other.glb", sphere(14));
    let compare =
        |more: &[&str]| folder.run(&[&["compare", "other.glb", "lods/scene.glb", "--views", "1"], more].concat());
    let refused = compare(&[]);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    refused.says("lods/scene.glb: object 'Ball' stands for node 0, which does not show it in other.glb; name the file");
    assert_eq!(compare(&["--objects", "0"]).code, 0);
}

#[test]
fn levels_and_kinds_of_objects_are_listed() {
    let folder = baked();
    let found = run(&folder, &["inspect", "lods/scene.glb", "--json"]).json();
    assert_eq!(names(&found["levels"]), NAMES);
    let calls: Vec<&Value> = (0..3).map(|level| &found["levels"][level]["draw_calls"]).collect();
    assert_eq!(calls, [1, 3, 3]);
    // Meshes that two balls share are in memory once, and the scrap is the source's: 40 triangles less than 60, and 80 less than
    // 120.
    let memory = |level: usize| found["levels"][level]["mesh_memory"].as_u64().expect("bytes");
    assert!(memory(1) < memory(0) && memory(1) < memory(2) && memory(2) < 2 * memory(0), "{found}");
    let object = &found["objects"][0];
    assert_eq!((&object["name"], &object["instances"], &object["triangles"]), (&json!("Ball"), &json!(2), &json!(288)));
    assert_eq!((&object["levels"][1]["level"], &object["levels"][1]["budget"]), (&json!(2), &json!(80)));
    assert_eq!(found["objects"].as_array().map(Vec::len), Some(1));
    let text = run(&folder, &["inspect", "lods/scene.glb"]).stdout;
    for start in ["whole LOD1 ", "LOD2 of all objects ", "Ball "] {
        assert!(text.lines().any(|line| line.starts_with(start)), "{start}: {text}");
    }
}

#[test]
fn the_page_shows_each_level_by_its_nodes_and_lists_the_objects() {
    let folder = baked();
    let of_source = [&["report", "--views", "2", "scene.glb"], &SETTINGS[..], &QUICK].concat();
    for (args, with_reports) in [(&of_source[..], true), (&["report", "--views", "2", "lods/scene.glb"], false)] {
        run(&folder, args);
        let html = std::fs::read_to_string(folder.path("report.html")).expect("a page");
        let between =
            |start: &str| html.split(start).nth(1).and_then(|rest| rest.split("</script>").next()).expect("an element");
        let figures: Value =
            serde_json::from_str(between("<script type=\"application/json\" id=\"report\">")).expect("JSON");
        let model = &figures["assets"][0];
        assert_eq!(names(&model["levels"]), NAMES);
        assert_eq!(model["levels"][1]["cost"]["draw_calls"], 3);
        let ball = &model["objects"][0];
        assert_eq!(
            (&ball["name"], &ball["instances"], ball["levels"][1]["psnr"].is_number()),
            (&json!("Ball"), &json!(2), with_reports)
        );
        assert!(html.contains("<th scope=\"row\">LOD1 of all objects</th>") && html.contains("data-value=\"Ball\""));

        let glb = STANDARD.decode(between("id=\"models-0\">")).expect("base64");
        let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
        let view: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
        assert_eq!(view["extras"]["levels"], json!(NAMES));
        let nodes = view["nodes"].as_array().expect("nodes");
        let shown = |part: usize| {
            let of_part = |node: &&Value| {
                node.pointer("/extras/parts").and_then(Value::as_array).is_some_and(|p| p.contains(&json!(part)))
            };
            nodes.iter().filter(of_part).map(|node| node["name"].as_str().expect("a name")).collect::<Vec<_>>()
        };
        assert_eq!(shown(0), ["Ball", "Ball.001", "Scrap"]);
        assert_eq!(shown(1), ["Whole LOD1"]);
        assert_eq!(shown(2), ["Scrap", "Ball LOD1", "Ball.001 LOD1"]);
        assert_eq!(shown(3), ["Scrap", "Ball LOD2", "Ball.001 LOD2"]);
    }
}
