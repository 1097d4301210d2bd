//! Several commands at work on one cache.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use crate::bake::{QUICK, quick};
use crate::folder::{Folder, sphere};

#[test]
fn two_processes_bake_a_model_once() {
    let folder = Folder::new().with("ball.glb", sphere(24));
    let start = |output| {
        let args = [&["bake", "ball.glb", "--faces", "100", "--json", "--output", output], &QUICK[..]].concat();
        folder.command(&args).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("starts")
    };
    let children = [start("a"), start("b")];
    let mut statuses = children.map(|child| {
        let output = child.wait_with_output().expect("ends");
        let document: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        document["assets"][0]["status"].as_str().expect("a status").to_owned()
    });
    statuses.sort();
    assert_eq!(statuses, ["baked", "hit"]);
    assert!(fs::read(folder.path("a/ball.glb")).expect("reads") == fs::read(folder.path("b/ball.glb")).expect("reads"));
}

#[cfg(unix)]
#[test]
fn the_bake_of_a_process_that_dies_is_taken_over() {
    // Large enough to be still at work when it is stopped.
    let folder = Folder::new().with("ball.glb", sphere(100));
    let start = |output| {
        let args = [&["bake", "ball.glb", "--faces", "100", "--output", output], &QUICK[..]].concat();
        let mut child = folder.command(&args).stderr(Stdio::piped()).spawn().expect("starts");
        let stderr = BufReader::new(child.stderr.take().expect("piped"));
        (child, stderr)
    };
    let read_until = |stderr: &mut BufReader<_>, text: &str| {
        let found = stderr.lines().map(|line| line.expect("reads")).find(|line| line.contains(text));
        assert!(found.is_some(), "no '{text}'");
    };
    let signal = |child: &Child, signal: &str| {
        let pid = child.id().to_string();
        assert!(Command::new("kill").args([signal, &pid]).status().expect("kill runs").success());
    };
    let (mut owner, mut owner_says) = start("a");
    read_until(&mut owner_says, "import (0 %)");
    signal(&owner, "-STOP");
    let (mut waiting, mut waiting_says) = start("b");
    read_until(&mut waiting_says, "another program is baking it");
    signal(&owner, "-KILL");
    assert!(!owner.wait().expect("ends").success());
    read_until(&mut waiting_says, "baked in");
    assert!(waiting.wait().expect("ends").success());
    assert!(folder.path("b/ball.glb").exists() && !folder.path("a").exists());
}

#[test]
fn machines_share_results_through_a_folder() {
    let folder = Folder::new().with("ball.glb", sphere(16)).with("server/readme.txt", "");
    let status = |cache: &str, shared: &str| {
        let run =
            quick(&folder, &["ball.glb", "--faces", "100", "--json", "--cache-dir", cache, "--shared-cache", shared]);
        (run.json()["assets"][0]["status"].as_str().expect("a status").to_owned(), run.stderr)
    };
    assert_eq!(status("a", "server").0, "baked");
    assert_eq!(status("b", "server").0, "hit");
    let (baked, stderr) = status("c", "nowhere");
    assert_eq!(baked, "baked");
    assert!(stderr.contains("warning: shared cache: cannot read from nowhere: there is no such folder"), "{stderr}");
}
