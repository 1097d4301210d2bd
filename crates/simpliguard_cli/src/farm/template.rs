//! The job template of Open Job Description, and the parameters of a job.
//!
//! The files are JSON, which every reader of YAML takes. So no second format is written, and no text of a user can be taken
//! for something else.

use serde_json::{Value, json};

use super::manifest::Manifest;
use super::worker::{Places, arguments};

/// Version of the format.
const SPECIFICATION: &str = "jobtemplate-2023-09";
/// The name of the only step.
pub(super) const STEP: &str = "Bake";
/// The name of the task parameter: the number of the task, from 1.
pub(super) const TASK: &str = "Task";

/// The job template: one step, whose tasks are numbered.
pub(super) fn template(manifest: &Manifest) -> Value {
    let parameter = |name: &str| format!("{{{{Param.{name}}}}}");
    let file = |folder: &str, extension: &str| format!("{{{{Param.{folder}}}}}/{{{{Task.Param.{TASK}}}}}.{extension}");
    let places = Places {
        assets: parameter("Assets"),
        project: parameter("Project"),
        cache_dir: parameter("CacheDir"),
        shared_cache: parameter("SharedCache"),
        settings: parameter("Settings"),
        list: file("Tasks", "txt"),
        report: file("Reports", "json"),
        output: "{{Session.WorkingDirectory}}/lods".to_owned(),
    };
    json!({
        "specificationVersion": SPECIFICATION,
        "name": "simpliguard",
        "description": "Bakes the levels of detail of the models that no cache has.",
        "parameterDefinitions": definitions(manifest),
        "steps": [{
            "name": STEP,
            "parameterSpace": {
                "taskParameterDefinitions": [
                    {"name": TASK, "type": "INT", "range": format!("1-{}", manifest.tasks.len())},
                ],
            },
            "script": {"actions": {"onRun": {
                "command": parameter("Command"),
                "args": arguments(manifest, &places, str::to_owned),
            }}},
            "hostRequirements": {"amounts": [
                {"name": "amount.worker.vcpu", "min": manifest.worker.cpus},
                {"name": "amount.worker.memory", "min": manifest.worker.memory},
            ]},
        }],
    })
}

/// The parameters that the template declares.
fn definitions(manifest: &Manifest) -> Vec<Value> {
    let path = |name: &str, kind: &str, flow: &str, description: &str| json!({"name": name, "type": "PATH", "objectType": kind, "dataFlow": flow, "description": description});
    let text = |name: &str, description: &str| json!({"name": name, "type": "STRING", "description": description});
    let with_default = |mut definition: Value, default: &str| {
        definition["default"] = default.into();
        definition
    };
    let mut definitions = vec![
        with_default(text("Command", "The command on a worker."), "simpliguard"),
        path("Assets", "DIRECTORY", "NONE", "The folder of the models."),
        with_default(path("Tasks", "DIRECTORY", "IN", "The list of models of each task."), "tasks"),
        with_default(path("Reports", "DIRECTORY", "OUT", "The report of each task."), "reports"),
    ];
    if manifest.project.is_some() {
        definitions.push(path("Project", "DIRECTORY", "NONE", "The project with the settings."));
    }
    if manifest.cache_dir.is_some() {
        definitions.push(path("CacheDir", "DIRECTORY", "NONE", "The folder of the cache."));
    }
    if manifest.shared_cache.is_some() {
        definitions.push(text("SharedCache", "The address of the shared cache."));
    }
    if manifest.has_settings {
        definitions.push(with_default(path("Settings", "FILE", "IN", "A file of settings."), "settings.ron"));
    }
    definitions
}

/// The values of the parameters that have no default.
pub(super) fn values(manifest: &Manifest) -> Vec<(&'static str, &str)> {
    let optional =
        [("Project", &manifest.project), ("CacheDir", &manifest.cache_dir), ("SharedCache", &manifest.shared_cache)];
    let given = optional.into_iter().filter_map(|(name, value)| Some((name, value.as_deref()?)));
    [("Assets", manifest.assets.as_str())].into_iter().chain(given).collect()
}
