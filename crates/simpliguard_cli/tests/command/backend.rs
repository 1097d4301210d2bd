//! The processor that refines levels.

use serde_json::Value;

use crate::bake::quick;
use crate::folder::{Folder, Run, sphere};

const STEPS: [&str; 6] = ["--faces", "100", "--set", "refine_steps=4", "--no-cache", "--json"];

fn device(run: &Run) -> Value {
    assert_eq!(run.code, 0, "{}", run.stderr);
    let asset = &run.json()["assets"][0];
    let level = &asset["levels"][0]["device"];
    assert_eq!(asset["device"], *level);
    level.clone()
}

fn warnings(run: &Run) -> usize {
    run.stderr.matches("levels are refined on the CPU: ").count()
}

#[test]
fn a_gpu_that_is_asked_for_is_named_or_missed() {
    let folder = Folder::new().with("a.glb", sphere(24)).with("b.glb", sphere(20));
    let run = quick(&folder, &[&["a.glb", "b.glb", "--backend", "gpu"], &STEPS[..]].concat());
    // Machines with a GPU, and those without.
    match device(&run) {
        Value::Null => assert_eq!(warnings(&run), 1, "{}", run.stderr),
        device => assert!(device.is_string() && warnings(&run) == 0, "{}", run.stderr),
    }
}

#[test]
fn the_cpu_is_used_where_the_project_or_the_command_line_says_so() {
    let project = b"(backend: Cpu)".as_slice();
    let folder = Folder::new().with("a.glb", sphere(24)).with("p/config/simpliguard.ron", project);
    let own = quick(&folder, &[&["a.glb", "--project", "p"], &STEPS[..]].concat());
    let flag = quick(&folder, &[&["a.glb", "--backend", "cpu"], &STEPS[..]].concat());
    for run in [own, flag] {
        assert_eq!((device(&run), warnings(&run)), (Value::Null, 0), "{}", run.stderr);
    }
}
