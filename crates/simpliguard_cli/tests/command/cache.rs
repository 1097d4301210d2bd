//! `simpliguard cache`.

use std::fs::{self, File};
use std::time::{Duration, SystemTime};

use walkdir::WalkDir;

use crate::bake::quick;
use crate::folder::{Folder, sphere};

fn baked() -> Folder {
    let folder = Folder::new().with("ball.glb", sphere(16));
    assert_eq!(quick(&folder, &["ball.glb", "--faces", "100"]).code, 0);
    folder
}

fn files(folder: &Folder, below: &str) -> Vec<std::path::PathBuf> {
    let entries = WalkDir::new(folder.path(below)).into_iter().map(|entry| entry.expect("lists"));
    entries.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path).collect()
}

#[test]
fn stats_count_what_a_bake_has_stored() {
    let folder = baked();
    let run = folder.run(&["cache", "stats", "--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let document = run.json();
    let usage = &document["usage"];
    assert_eq!((&document["version"], &usage["results"]["files"]), (&1.into(), &1.into()));
    let count = |below| files(&folder, below).len() as u64;
    assert_eq!(usage["objects"]["files"], count("cache/objects"));
    assert_eq!(usage["stages"]["files"], count("cache/stages"));
    assert!(count("cache/stages") > 0);
    let text = folder.run(&["cache", "stats"]).stdout;
    assert!(text.contains("of 10.0 GiB") && text.contains("1, of them 0 incomplete"), "{text}");
}

#[test]
fn gc_keeps_to_the_size_of_the_project_or_the_command_line() {
    let folder = baked().with("config/simpliguard.ron", "(cache: (max_size: \"1 MiB\"))");
    let stats = folder.run(&["cache", "stats", "--json"]).json();
    assert_eq!(stats["max_size"], 1 << 20);
    assert_eq!(folder.run(&["cache", "gc"]).stdout.split(',').next(), Some("removed 0 results and 0 stage objects"));
    let large = "cache/objects/aa/".to_owned() + &"b".repeat(62);
    let folder = folder.with(&large, vec![0; 2 << 20]);
    for file in files(&folder, "cache") {
        let file = File::options().append(true).open(file).expect("opens");
        file.set_modified(SystemTime::now() - Duration::from_secs(3600)).expect("sets the time");
    }
    let run = folder.run(&["cache", "gc", "--max-size", "5GiB", "--json"]);
    assert_eq!(run.json()["collected"]["freed"], 2 << 20, "{}", run.stderr);
    assert_eq!(quick(&folder, &["ball.glb", "--faces", "100", "--json"]).json()["assets"][0]["status"], "hit");
    let run = folder.run(&["cache", "gc", "--max-size", "5"]);
    assert_eq!(run.code, 2);
    run.says("expected at least 1.0 MiB, with a unit");
}

#[test]
fn verify_finds_damage_and_clear_empties() {
    let folder = baked();
    let verify = || folder.run(&["cache", "verify", "--json"]);
    let clean = verify();
    assert_eq!((clean.code, clean.json()["verified"]["damaged"].as_array().map(Vec::len)), (0, Some(0)));
    fs::write(&files(&folder, "cache/objects")[0], "rot").expect("writes");
    let run = verify();
    assert_eq!((run.code, &run.json()["verified"]["incomplete"]), (1, &1.into()));
    run.says("does not match its hash; moved to quarantine");
    assert_eq!(folder.run(&["cache", "clear"]).code, 0);
    assert!(files(&folder, "cache").is_empty());
    let run = folder.run(&["cache", "verify"]);
    assert_eq!((run.code, run.stdout.as_str()), (0, "checked 0 files with 0 B: 0 damaged, 0 incomplete results\n"));
}
