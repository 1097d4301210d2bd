//! `simpliguard farm`.

use std::fs;

use serde_json::Value;

use crate::bake::QUICK;
use crate::folder::{Folder, Run, sphere};

fn plan(folder: &Folder, args: &[&str]) -> Run {
    let fixed = ["farm", "plan", "--bundle", "bundle", "--json", "--faces", "100"];
    folder.run(&[&fixed, args, &QUICK].concat())
}

fn library() -> Folder {
    let folder = Folder::new().with("assets/a.glb", sphere(12)).with("assets/copy of a.glb", sphere(12));
    folder.with("assets/deep/b.glb", sphere(14))
}

fn read(folder: &Folder, file: &str) -> Value {
    let text = fs::read_to_string(folder.path(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
    serde_json::from_str(&text).expect("JSON")
}

/// The value of a parameter of the job: given, or by default.
fn parameter(folder: &Folder, definition: &Value) -> (String, String) {
    let name = definition["name"].as_str().expect("a name");
    let values = read(folder, "bundle/parameter_values.yaml");
    let given = values["parameterValues"].as_array().expect("values").iter().find(|value| value["name"] == name);
    let text = match given {
        Some(given) => given["value"].as_str().expect("a text").to_owned(),
        None => {
            let default = definition["default"].as_str().expect("a default");
            let is_path = definition["type"] == "PATH";
            if is_path { folder.path("bundle").join(default).display().to_string() } else { default.to_owned() }
        }
    };
    (format!("{{{{Param.{name}}}}}"), text)
}

/// Runs the tasks of a bundle as a scheduler does, by what the template says.
fn run_tasks(folder: &Folder) -> Vec<i32> {
    let template = read(folder, "bundle/template.yaml");
    let definitions = template["parameterDefinitions"].as_array().expect("definitions");
    let parameters: Vec<_> = definitions.iter().map(|definition| parameter(folder, definition)).collect();
    let step = &template["steps"][0];
    let action = &step["script"]["actions"]["onRun"];
    assert_eq!(action["command"], "{{Param.Command}}");
    let range = step["parameterSpace"]["taskParameterDefinitions"][0]["range"].as_str().expect("a range");
    let tasks: usize = range.strip_prefix("1-").and_then(|last| last.parse().ok()).expect("1-N");
    let run = |task: usize| {
        let filled = |arg: &Value| {
            let arg = arg.as_str().expect("a text").replace("{{Task.Param.Task}}", &task.to_string());
            let arg = arg.replace("{{Session.WorkingDirectory}}", &folder.path("session").display().to_string());
            parameters.iter().fold(arg, |arg, (name, value)| arg.replace(name, value))
        };
        let args: Vec<String> = action["args"].as_array().expect("args").iter().map(filled).collect();
        assert!(args.iter().all(|arg| !arg.contains("{{")), "{args:?}");
        folder.run(&args.iter().map(String::as_str).collect::<Vec<_>>()).code
    };
    (1..=tasks).map(run).collect()
}

#[test]
fn a_plan_holds_what_is_missing_once_and_is_empty_when_it_was_carried_out() {
    let folder = library();
    let run = plan(&folder, &["assets", "--task-time", "1s", "--cache-dir", "farm cache"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let document = run.json();
    let numbers =
        |document: &Value| ["assets", "hits", "misses", "duplicates", "tasks"].map(|name| document[name].clone());
    assert_eq!(numbers(&document), [3, 0, 2, 1, 2].map(Value::from));
    let lists = [1, 2].map(|task| fs::read_to_string(folder.path(&format!("bundle/tasks/{task}.txt"))).expect("reads"));
    assert_eq!(lists, ["deep/b.glb\n", "a.glb\n"], "the longest first");
    let status = || folder.run(&["farm", "status", "--bundle", "bundle", "--json"]);
    assert_eq!((status().code, status().json()["open"].clone()), (1, 3.into()));
    assert_eq!(run_tasks(&folder), [0, 0]);
    let done = status();
    assert_eq!((done.code, &done.json()["done"], &done.json()["baked"]), (0, &3.into(), &2.into()));
    let run = plan(&folder, &["assets", "--cache-dir", "farm cache"]);
    assert_eq!((run.code, numbers(&run.json())), (0, [3, 3, 0, 0, 0].map(Value::from)));
    assert!(!folder.path("bundle/template.yaml").exists() && !folder.path("bundle/tasks/1.txt").exists());
    assert_eq!(folder.run(&["farm", "submit", "--slurm", "--bundle", "bundle"]).code, 0);
}

#[test]
fn a_job_is_one_of_open_job_description() {
    let folder = library().with("own.ron", "(texture_size: 64)").with("config/simpliguard.ron", "()");
    let flags = ["--settings", "own.ron", "--worker-cpus", "8", "--worker-memory", "32GiB", "--shared-cache", "server"];
    let run = plan(&folder, &[&["assets"], &flags[..]].concat());
    assert_eq!(run.code, 0, "{}", run.stderr);
    let template = read(&folder, "bundle/template.yaml");
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    let amounts = &template["steps"][0]["hostRequirements"]["amounts"];
    assert_eq!((&amounts[0]["min"], &amounts[1]["min"]), (&8.into(), &32768.into()));
    let values = read(&folder, "bundle/parameter_values.yaml");
    let names: Vec<_> = values["parameterValues"].as_array().expect("values").iter().map(|v| &v["name"]).collect();
    assert_eq!(names, ["Assets", "Project", "SharedCache"]);
    let references = read(&folder, "bundle/asset_references.yaml");
    let files: Vec<_> = references["assetReferences"]["inputs"]["filenames"].as_array().expect("files").to_vec();
    let expected = ["assets/a.glb", "assets/deep/b.glb", "config/simpliguard.ron"];
    assert_eq!(files, expected.map(|file| Value::from(folder.path(file).display().to_string())));
    assert_eq!(fs::read_to_string(folder.path("bundle/settings.ron")).expect("reads"), "(texture_size: 64)");
}

#[test]
fn failures_are_reported_by_their_causes() {
    let folder = library().with("assets/x.glb", "broken").with("assets/y.glb", "broken");
    let run = plan(&folder, &["assets"]);
    assert_eq!((run.code, run.json()["failed"].as_array().map(Vec::len)), (1, Some(2)));
    run.says("error: assets/x.glb: import: ");
    // Changed after the plan, so that the worker's result has another key.
    fs::write(folder.path("assets/deep/b.glb"), sphere(13)).expect("writes");
    assert_eq!(run_tasks(&folder), [0]);
    let run = folder.run(&["farm", "status", "--bundle", "bundle", "--json"]);
    let document = run.json();
    assert_eq!(run.code, 1);
    assert_eq!([&document["done"], &document["open"], &document["failed"]], [2, 1, 2].map(Value::from).each_ref());
    assert_eq!(document["causes"][0]["inputs"], serde_json::json!(["assets/x.glb", "assets/y.glb"]));
    assert!(document["causes"][1]["cause"].as_str().is_some_and(|cause| cause.contains("changed after the plan")));
}

#[test]
fn a_worker_of_another_version_is_named() {
    let folder = library();
    assert_eq!(plan(&folder, &["assets"]).code, 0);
    // What a worker of another version leaves: a report with keys of its own, and nothing under those of the plan.
    let own =
        folder.run(&["bake", "assets", "--json", "--faces", "60"].iter().chain(&QUICK).copied().collect::<Vec<_>>());
    let mut report = own.json();
    report["pipeline_version"] = "1".into();
    fs::write(folder.path("bundle/reports/1.json"), report.to_string()).expect("writes");
    let run = folder.run(&["farm", "status", "--bundle", "bundle", "--json"]);
    assert_eq!((run.code, &run.json()["open"]), (1, &3.into()), "{}", run.stderr);
    let cause = run.json()["causes"][0]["cause"].to_string();
    assert!(cause.contains("version 1 of the pipeline") && cause.contains("plan again"), "{cause}");
}

#[cfg(unix)]
#[test]
fn a_task_of_slurm_bakes_its_models() {
    let folder = library();
    assert_eq!(plan(&folder, &["assets"]).code, 0);
    let submit = ["farm", "submit", "--slurm", "--bundle", "bundle", "--dry-run", "--", "--partition=farm"];
    let run = folder.run(&submit);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stdout.starts_with("sbatch --parsable --array=1-1 --export=ALL,SIMPLIGUARD_FIRST_TASK=0 "));
    assert!(run.stdout.contains(" --partition=farm ") && run.stdout.ends_with("bundle/slurm.sh\n"), "{}", run.stdout);
    let mut shell = std::process::Command::new("sh");
    shell.arg(folder.path("bundle/slurm.sh")).env("SIMPLIGUARD_CACHE_DIR", folder.path("cache"));
    let status = shell.env("SLURM_ARRAY_TASK_ID", "1").env("SIMPLIGUARD_FIRST_TASK", "0").status().expect("starts");
    assert!(status.success());
    assert_eq!(folder.run(&["farm", "status", "--bundle", "bundle"]).code, 0);
}

#[test]
fn a_folder_with_other_files_is_no_place_for_a_bundle() {
    let folder = library().with("bundle/thesis.txt", "mine");
    let run = plan(&folder, &["assets"]);
    assert_eq!(run.code, 2);
    run.says("--bundle bundle: the folder holds other files; choose a new or empty one");
    let run = folder.run(&["farm", "status", "--bundle", "nowhere"]);
    assert_eq!(run.code, 2);
    run.says("make the bundle with `simpliguard farm plan`");
    let run = folder.run(&["farm", "plan", "assets", "--bundle", "new", "--set", "importance={{"]);
    assert_eq!(run.code, 2);
}
