//! `simpliguard cache`.

use std::fs::{self, File};
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use walkdir::WalkDir;

#[cfg(unix)]
use crate::bake::QUICK;
use crate::bake::quick;
use crate::folder::{Folder, sphere};

fn baked() -> Folder {
    let folder = Folder::new().with("ball.glb", sphere(16));
    assert_eq!(quick(&folder, &["ball.glb", "--faces", "100"]).code, 0);
    folder
}

fn files(folder: &Folder, below: &str) -> Vec<PathBuf> {
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
    assert_eq!(usage["objects"]["files"], count("cache/simpliguard-v1/objects"));
    assert_eq!(usage["stages"]["files"], count("cache/simpliguard-v1/stages"));
    assert!(count("cache/simpliguard-v1/stages") > 0);
    let text = folder.run(&["cache", "stats"]).stdout;
    assert!(text.contains("of 10.0 GiB") && text.contains("1, of them 0 incomplete"), "{text}");
}

#[test]
fn gc_keeps_to_the_size_of_the_project_or_the_command_line() {
    let folder = baked().with("config/simpliguard.ron", "(cache: (max_size: \"1 MiB\"))");
    let stats = folder.run(&["cache", "stats", "--json"]).json();
    assert_eq!(stats["max_size"], 1 << 20);
    assert_eq!(folder.run(&["cache", "gc"]).stdout.split(',').next(), Some("removed 0 results and 0 stage objects"));
    let large = "cache/simpliguard-v1/objects/aa/".to_owned() + &"b".repeat(62);
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
    fs::write(&files(&folder, "cache/simpliguard-v1/objects")[0], "rot").expect("writes");
    let run = verify();
    assert_eq!((run.code, &run.json()["verified"]["incomplete"]), (1, &1.into()));
    run.says("does not match its hash; moved to quarantine");
    assert_eq!(folder.run(&["cache", "clear"]).code, 0);
    assert!(files(&folder, "cache").is_empty());
    let run = folder.run(&["cache", "verify"]);
    assert_eq!((run.code, run.stdout.as_str()), (0, "checked 0 files with 0 B: 0 damaged, 0 incomplete results\n"));
}

/// Writes a file of the user, which nobody has touched for an hour.
fn old_file(folder: &Folder, path: &str) -> PathBuf {
    let path = folder.path(path);
    fs::create_dir_all(path.parent().expect("in a folder")).expect("makes");
    fs::write(&path, "the user's").expect("writes");
    let file = File::options().append(true).open(&path).expect("opens");
    file.set_modified(SystemTime::now() - Duration::from_secs(3600)).expect("sets the time");
    path
}

#[test]
fn clear_removes_nothing_that_the_cache_has_not_made() {
    let folder = baked();
    let names = ["results/plot.csv", "simpliguard-v1/results/plot.csv", "simpliguard-v1/notes.txt"];
    let mut kept = names.map(|name| old_file(&folder, &format!("cache/{name}"))).to_vec();
    let run = folder.run(&["cache", "clear"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    kept.push(folder.path("cache/simpliguard-v1/CACHEDIR.TAG"));
    kept.sort();
    let mut left = files(&folder, "cache");
    left.sort();
    assert_eq!(left, kept);
    assert_eq!(quick(&folder, &["ball.glb", "--faces", "100", "--json"]).json()["assets"][0]["status"], "baked");
    assert_eq!(quick(&folder, &["ball.glb", "--faces", "100", "--json"]).json()["assets"][0]["status"], "hit");
}

#[test]
fn a_folder_of_somebody_else_is_reported_and_left_alone() {
    let folder = Folder::new().with("ball.glb", sphere(16));
    let theirs = old_file(&folder, "cache/simpliguard-v1/objects/notes.txt");
    let found =
        "simpliguard-v1 is not used: it holds 'objects' but no CACHEDIR.TAG of this program; delete or rename it";
    let run = quick(&folder, &["ball.glb", "--faces", "100"]);
    assert_eq!(run.code, 0);
    run.says("warning: the result is not kept: cache: ");
    run.says(found);
    for (command, code) in [("stats", 0), ("verify", 0), ("gc", 1), ("clear", 1)] {
        let run = folder.run(&["cache", command]);
        assert_eq!(run.code, code, "{command}: {}", run.stderr);
        run.says(found);
    }
    assert_eq!(files(&folder, "cache"), [theirs]);
}

/// The command in the folder of a project, with a user's cache folder and no variable that says where the cache is.
#[cfg(unix)]
fn bake_project(folder: &Folder, args: &[&str]) -> (serde_json::Value, String) {
    let args = [&["bake", "game/assets", "--faces", "100", "--json"], args, &QUICK[..]].concat();
    let mut command = folder.command(&args);
    command.env_remove("SIMPLIGUARD_CACHE_DIR").env("HOME", folder.path("user")).env_remove("XDG_CACHE_HOME");
    let output = command.output().expect("starts");
    let stderr = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(output.status.success(), "{stderr}");
    (serde_json::from_slice(&output.stdout).expect("JSON"), stderr)
}

#[cfg(unix)]
#[test]
fn a_project_does_not_send_its_cache_elsewhere() {
    let folder = Folder::new().with("game/assets/a.glb", sphere(12)).with("game/assets/b.glb", sphere(16));
    let folder = folder.with("game/config/simpliguard.ron", "(cache: (dir: \"../.git\", max_size: \"1 MiB\"))");
    let loose = format!("ab/{}", "c".repeat(38));
    let sha256 = format!("ab/{}", "c".repeat(62));
    let mut repository: Vec<PathBuf> = ["HEAD".to_owned(), format!("objects/{loose}"), format!("objects/{sha256}")]
        .iter()
        .map(|name| old_file(&folder, &format!(".git/{name}")))
        .collect();
    repository.sort();
    let tree = || {
        let mut files = files(&folder, ".git");
        files.sort();
        files
    };
    let (_, stderr) = bake_project(&folder, &[]);
    assert_eq!(stderr.matches("warning: config/simpliguard.ron: cache.dir: \"../.git\" is not used").count(), 1);
    assert!(stderr.contains("pass --cache-dir or set SIMPLIGUARD_CACHE_DIR"), "{stderr}");
    assert_eq!(tree(), repository);
    let (document, _) = bake_project(&folder, &[]);
    assert_eq!(document["assets"][0]["status"], "hit", "in the user's cache folder");
    // Who names the folder gets it, and the repository stays what it is.
    let (_, stderr) = bake_project(&folder, &["--cache-dir", ".git"]);
    assert!(!stderr.contains("warning"), "{stderr}");
    assert!(tree().len() > repository.len() && repository.iter().all(|path| path.exists()));
}

#[cfg(unix)]
#[test]
fn a_project_that_is_its_own_cache_folder_keeps_its_files() {
    let folder = Folder::new().with("game/assets/a.glb", sphere(12));
    let folder = folder.with("game/config/simpliguard.ron", "(cache: (dir: \".\"))");
    let names = ["results/plot.csv", "objects/chair.obj", "stages/1.txt", "locks/ab/notes.txt", "quarantine/x"];
    let kept = names.map(|name| old_file(&folder, &format!("game/{name}")));
    let (_, stderr) = bake_project(&folder, &[]);
    assert!(!stderr.contains("warning"), "{stderr}");
    assert_eq!(bake_project(&folder, &[]).0["assets"][0]["status"], "hit");
    assert!(folder.path("game/simpliguard-v1/CACHEDIR.TAG").exists());
    for command in ["gc", "clear"] {
        assert_eq!(folder.run(&["cache", command, "--cache-dir", "game"]).code, 0);
    }
    assert!(kept.iter().all(|path| path.exists()) && !folder.path("game/simpliguard-v1").exists());
}

#[test]
fn a_sample_is_baked_again_and_compared() {
    // Settings on the command line are not those of the project, so the project has them.
    let quick = "texture_size: 64, views: 8, view_size: 128, candidates: Source, quality: Draft, faces: [100]";
    let folder = Folder::new().with("assets/a.glb", sphere(12)).with("assets/b.glb", sphere(14));
    let folder = folder.with("config/simpliguard.ron", format!("(defaults: ({quick}))"));
    assert_eq!(folder.bake(&["assets"]).code, 0);
    let verify = |percent| folder.run(&["cache", "verify", "--rebake", percent, "assets", "--json"]);
    let run = verify("1%");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!([&run.json()["rebaked"]["found"], &run.json()["rebaked"]["rebaked"]], [&2, &1]);
    assert_eq!(verify("100%").json()["rebaked"]["rebaked"], 2);
    for wrong in ["0%", "1", "101%"] {
        assert_eq!(verify(wrong).code, 2, "{wrong}");
    }
}

#[test]
fn counts_of_all_runs_are_printed() {
    let folder = baked().with("server/readme.txt", "");
    let args = ["ball.glb", "--faces", "100", "--json", "--cache-dir", "second", "--shared-cache", "server"];
    let first = quick(&folder, &args).json();
    assert_eq!([&first["cache"]["shared"]["misses"], &first["cache"]["shared"]["stored"]], [&1, &1]);
    assert_eq!(quick(&folder, &args).json()["cache"]["local"]["hits"], 1);
    let run = folder.run(&["cache", "stats", "--json", "--cache-dir", "second"]);
    let local = &run.json()["tiers"]["local"];
    assert_eq!([&local["hits"], &local["misses"], &local["stored"]], [&1, &1, &1]);
    let text = folder.run(&["cache", "stats", "--cache-dir", "second"]).stdout;
    assert!(text.contains("local       1 hits, 1 misses, 1 stored, 0 damaged\n"), "{text}");
}

#[test]
fn a_key_is_written_once() {
    let folder = Folder::new();
    let run = folder.run(&["cache", "keygen", "build.key"]);
    assert_eq!((run.code, run.stdout.trim().len()), (0, 64), "{}", run.stderr);
    let secret = fs::read(folder.path("build.key")).expect("reads");
    let run = folder.run(&["cache", "keygen", "build.key"]);
    assert_eq!(run.code, 2);
    run.says("choose a new file");
    assert_eq!(fs::read(folder.path("build.key")).expect("reads"), secret);
}

#[test]
fn a_shared_cache_that_can_never_be_used_is_refused_before_a_bake() {
    let folder = Folder::new().with("ball.glb", sphere(16)).with("file", "");
    for (address, found) in [("gopher://levels", "cannot be used"), ("file", "it is no folder")] {
        let run = quick(&folder, &["ball.glb", "--shared-cache", address, "--json"]);
        assert_eq!((run.code, &run.json()["assets"]), (2, &serde_json::json!([])), "{address}: {}", run.stderr);
        run.says(found);
        assert!(!folder.path("lods").exists());
    }
}
