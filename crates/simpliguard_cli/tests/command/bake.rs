//! Bakes of small models from end to end.

use std::fs;
use std::path::Path;

use crate::folder::{Folder, sphere, triangle};

pub(crate) const QUICK: [&str; 10] = [
    "--quality",
    "draft",
    "--set",
    "texture_size=64",
    "--set",
    "views=8",
    "--set",
    "view_size=128",
    "--set",
    "candidates=source",
];

pub(crate) fn quick(folder: &Folder, args: &[&str]) -> crate::folder::Run {
    folder.bake(&[args, &QUICK].concat())
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("the folder exists");
    let mut names: Vec<_> = entries.map(|e| e.expect("lists").file_name().into_string().expect("UTF-8")).collect();
    names.sort();
    names
}

#[test]
fn levels_are_written_within_their_budgets_and_found_again() {
    let folder = Folder::new().with("in/deep/ball.glb", sphere(24));
    let args = ["in", "--faces", "200,100", "--split-levels", "--json"];
    let run = quick(&folder, &args);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let asset = &run.json()["assets"][0];
    assert_eq!(asset["status"], "baked");
    for (i, budget) in [100, 200].into_iter().enumerate() {
        let level = &asset["levels"][i];
        assert_eq!((level["level"].as_u64(), level["budget"].as_u64()), (Some(i as u64 + 1), Some(budget)));
        let faces = level["faces"].as_u64().expect("a count");
        assert!(faces <= budget && (faces * 100 >= budget * 98 || !level["stopped"].is_null()), "{level}");
        assert_eq!(level["path"], format!("lods/deep/ball_{budget}.glb"));
    }
    let out = folder.path("lods/deep");
    assert_eq!(names(&out), ["ball.glb", "ball_100.glb", "ball_200.glb"]);

    let first: Vec<_> = names(&out).iter().map(|n| fs::read(out.join(n)).expect("reads")).collect();
    fs::remove_dir_all(folder.path("lods")).expect("removes");
    // A renamed file is still found.
    fs::rename(folder.path("in/deep/ball.glb"), folder.path("in/deep/moved.glb")).expect("renames");
    let again = quick(&folder, &args);
    assert_eq!(again.json()["assets"][0]["status"], "hit", "{}", again.stderr);
    assert_eq!(names(&out), ["moved.glb", "moved_100.glb", "moved_200.glb"]);
    let second: Vec<_> = names(&out).iter().map(|n| fs::read(out.join(n)).expect("reads")).collect();
    assert!(first == second, "a hit differs from its bake");
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let folder = Folder::new().with("ball.glb", sphere(24));
    let bake = |threads, output: &str| {
        let args = ["ball.glb", "--faces", "100", "--no-cache", "--threads", threads, "--output", output];
        let run = quick(&folder, &args);
        assert_eq!(run.code, 0, "{}", run.stderr);
        fs::read(folder.path(output).join("ball.glb")).expect("reads")
    };
    assert!(bake("1", "one") == bake("3", "three"));
    assert!(!folder.path("cache").exists(), "--no-cache wrote to the cache");
}

#[test]
fn processes_of_their_own_bake_the_same_bytes() {
    let folder = Folder::new().with("in/ball.glb", sphere(24)).with("in/broken.glb", b"glTF");
    let bake = |out: &str, args: &[&str]| {
        let given = ["in", "--faces", "100", "--split-levels", "--sheet", "--no-cache", "--json", "--output", out];
        let run = quick(&folder, &[&given, args].concat());
        assert_eq!(run.code, 1, "{}", run.stderr);
        let assets = run.json()["assets"].clone();
        assert!(assets[1]["error"].as_str().is_some_and(|e| e.contains("broken.glb: import: ")), "{assets}");
        assert!(!run.stderr.contains("it is baked in this process"), "{}", run.stderr);
        let out = folder.path(out);
        names(&out).into_iter().map(|name| (fs::read(out.join(&name)).expect("reads"), name)).collect::<Vec<_>>()
    };
    let isolated = bake("isolated", &["--isolate"]);
    assert_eq!(isolated.len(), 3);
    assert!(isolated == bake("plain", &[]), "the bytes differ");
}

#[test]
fn a_small_model_passes_through_and_the_bad_one_beside_it_fails_alone() {
    let folder = Folder::new().with("in/small.glb", triangle()).with("in/bad.glb", "glTF");
    let run = folder.bake(&["in", "--json"]);
    assert_eq!(run.code, 1);
    let document = run.json();
    assert_eq!(document["assets"][0]["status"], "failed");
    assert_eq!(document["assets"][1]["status"], "small_enough");
    assert_eq!(names(&folder.path("lods")), ["small.glb"]);
}

#[test]
fn a_changed_setting_bakes_again_and_a_damaged_cache_heals() {
    let folder = Folder::new().with("ball.glb", sphere(16));
    let status = |faces| {
        let run = quick(&folder, &["ball.glb", "--json", "--faces", faces]);
        (run.json()["assets"][0]["status"].as_str().expect("a status").to_owned(), run.stderr)
    };
    assert_eq!(status("100").0, "baked");
    assert_eq!(status("90").0, "baked");
    assert_eq!(status("100").0, "hit");
    for first in fs::read_dir(folder.path("cache/simpliguard-v1/objects")).expect("objects") {
        for object in fs::read_dir(first.expect("lists").path()).expect("objects") {
            fs::write(object.expect("lists").path(), b"rot").expect("writes");
        }
    }
    let (rotten, stderr) = status("100");
    assert_eq!(rotten, "baked");
    assert!(stderr.contains("moved to quarantine"), "{stderr}");
    assert_eq!(status("100").0, "hit");
}

#[test]
fn a_cache_that_cannot_be_written_is_a_warning() {
    let folder = Folder::new().with("ball.glb", sphere(16)).with("file", "");
    let run = quick(&folder, &["ball.glb", "--faces", "100", "--cache-dir", "file"]);
    assert_eq!(run.code, 0);
    run.says("warning: the result is not kept: cache: cannot write");
    assert!(folder.path("lods/ball.glb").exists());
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_with_130_within_a_second_and_leaves_nothing() {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    // Large enough to be still at work when the signal arrives.
    let folder = Folder::new().with("ball.glb", sphere(300));
    let mut command = folder.command(&["bake", "ball.glb", "--quality", "best"]);
    let mut child = command.stderr(Stdio::piped()).spawn().expect("starts");
    let mut stderr = BufReader::new(child.stderr.take().expect("piped"));
    let mut line = String::new();
    stderr.read_line(&mut line).expect("reads");
    assert!(line.contains("ball.glb"), "{line}");
    let start = Instant::now();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill runs").success());
    let code = child.wait().expect("ends").code();
    assert_eq!(code, Some(130));
    assert!(start.elapsed() < Duration::from_secs(1));
    assert!(!folder.path("lods").exists());
}

#[test]
fn a_contact_sheet_is_made_once_and_kept() {
    let folder = Folder::new().with("ball.glb", sphere(16));
    let bake = |flag: &[&str]| {
        let run = quick(&folder, &[&["ball.glb", "--json", "--faces", "100"], flag].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        run.json()["assets"][0].clone()
    };
    assert!(bake(&[])["sheet"].is_null());
    assert_eq!(bake(&["--sheet"])["sheet"], "lods/ball_sheet.png");
    let png = fs::read(folder.path("lods/ball_sheet.png")).expect("reads");
    assert!(png.starts_with(b"\x89PNG"));
    fs::remove_file(folder.path("lods/ball_sheet.png")).expect("removes");
    assert_eq!(bake(&["--sheet"])["status"], "hit");
    assert!(fs::read(folder.path("lods/ball_sheet.png")).expect("reads") == png);
}

#[test]
fn a_turntable_is_drawn_from_a_cached_result_too() {
    let folder = Folder::new().with("ball.glb", sphere(16));
    let bake = |flag: &[&str]| {
        let run = quick(&folder, &[&["ball.glb", "--json", "--faces", "100"], flag].concat());
        assert_eq!(run.code, 0, "{}", run.stderr);
        run.json()["assets"][0].clone()
    };
    assert!(bake(&[])["turntable"].is_null());
    let asset = bake(&["--turntable"]);
    assert_eq!((&asset["status"], &asset["turntable"]), (&"hit".into(), &"lods/ball_turntable.png".into()));
    let png = fs::read(folder.path("lods/ball_turntable.png")).expect("reads");
    assert!(png.starts_with(b"\x89PNG"));
    // The chunk that makes a PNG an animation follows the header's 33 bytes.
    assert_eq!(&png[37..41], b"acTL");
}
