//! Files from anywhere, and files that go away.

use std::fs::{self, File};
use std::time::{Duration, SystemTime};

use crate::folder::{Folder, TRIANGLE, sphere, triangle, triangle_beside};

#[cfg(unix)]
#[test]
fn links_lead_into_the_project_and_no_further() {
    use std::os::unix::fs::symlink;
    let folder =
        Folder::new().with("game/models/a.gltf", triangle_beside("data/a.bin")).with("game/data/a.bin", TRIANGLE);
    symlink("../data", folder.path("game/models/data")).expect("links");
    let bake = |args: &[&str]| folder.bake(&[&["game/models/a.gltf"], args].concat());
    let run = bake(&[]);
    assert_eq!(run.code, 1);
    run.says("cannot read 'data/a.bin': a link leads out of the model's folder and its project");
    assert_eq!(bake(&["--project", "game"]).code, 0);
    fs::create_dir(folder.path("game/config")).expect("makes");
    fs::write(folder.path("game/config/simpliguard.ron"), "()").expect("writes");
    assert_eq!(bake(&[]).code, 0);
}

#[cfg(unix)]
#[test]
fn special_files_are_not_read() {
    use std::os::unix::fs::symlink;
    let folder = Folder::new().with("a.gltf", triangle_beside("pipe.bin")).with("b.gltf", triangle_beside("zeros"));
    for pipe in ["pipe.bin", "c.glb"] {
        assert!(std::process::Command::new("mkfifo").arg(folder.path(pipe)).status().expect("runs").success());
    }
    symlink("/dev/zero", folder.path("zeros")).expect("links");
    symlink("/dev/zero", folder.path("d.glb")).expect("links");
    // The project holds everything, so that no rule on links comes first.
    let run = folder.bake(&["a.gltf", "b.gltf", "c.glb", "d.glb", "--project", "/"]);
    assert_eq!((run.code, run.stderr.matches("it is not a regular file").count()), (1, 4), "{}", run.stderr);
    let run = folder.bake(&["a.gltf", "--settings", "zeros"]);
    assert_eq!(run.code, 2);
    run.says("cannot read zeros: it is not a regular file");
}

#[cfg(unix)]
#[test]
fn texts_of_files_do_not_steer_the_terminal() {
    let name = "\u{1b}[2Jfox\u{9b}\n.glb";
    let extension = r#"{"asset": {"version": "2.0"}, "extensionsRequired": ["ACME_\u001b]0;title\u0007"]}"#;
    let folder = Folder::new().with(name, triangle()).with("bad.gltf", extension);
    let folder = folder.with("config/simpliguard.ron", "(cache: (dir: \"../\u{1b}[31m\"))");
    for args in [&[name, "bad.gltf"][..], &[name, "bad.gltf", "--json"], &["bad.gltf", "--set", "x\u{1b}=1"]] {
        let run = folder.bake(args);
        let output = run.stdout + &run.stderr;
        assert!(!output.contains(|c: char| c.is_control() && c != '\n'), "{output:?}");
        assert!(output.contains("\\u{1b}"), "{output}");
    }
}

#[test]
fn a_file_with_a_byte_order_mark_is_read() {
    let folder =
        Folder::new().with("a.glb", triangle()).with("config/simpliguard.ron", "\u{feff}(defaults: (views: 9))");
    let folder = folder.with("a.glb.meta", "\u{feff}(meta_format_version: \"1.0\", asset: Ignore)");
    let run = folder.run(&["settings", "show", "a.glb"]);
    assert!(run.stdout.contains("views: 9, "), "{}{}", run.stdout, run.stderr);
}

#[test]
fn a_server_is_no_place_for_the_cache_of_a_project() {
    let folder = Folder::new().with("a.glb", triangle());
    let folder = folder.with("config/simpliguard.ron", "(cache: (dir: \"//server/share\"))");
    let mut command = folder.command(&["bake", "a.glb"]);
    command.env_remove("SIMPLIGUARD_CACHE_DIR").env("HOME", folder.path("user")).env_remove("XDG_CACHE_HOME");
    let stderr = String::from_utf8(command.output().expect("starts").stderr).expect("UTF-8");
    assert!(stderr.contains("cache.dir: \"//server/share\" is not used"), "{stderr}");
}

#[test]
fn what_killed_runs_have_left_is_removed_later() {
    let folder = Folder::new().with("a.glb", triangle());
    for (name, age) in [(".simpliguard-abc123.tmp", 7200), (".simpliguard-def456.tmp", 60), ("mine.tmp", 7200)] {
        fs::create_dir_all(folder.path("lods")).expect("makes");
        let file = File::create(folder.path("lods").join(name)).expect("creates");
        file.set_modified(SystemTime::now() - Duration::from_secs(age)).expect("sets the time");
    }
    assert_eq!(folder.bake(&["a.glb"]).code, 0);
    let left = |name: &str| folder.path("lods").join(name).exists();
    assert!(!left(".simpliguard-abc123.tmp") && left(".simpliguard-def456.tmp") && left("mine.tmp") && left("a.glb"));
}

#[test]
fn a_model_that_is_deleted_during_its_bake_loses_nothing() {
    use std::io::{BufRead, BufReader, Read};
    use std::process::Stdio;
    let folder = Folder::new().with("ball.glb", sphere(16)).with("ball2.glb", triangle());
    let args = [&["bake", "ball.glb", "ball2.glb", "--faces", "100", "--turntable"], &crate::bake::QUICK[..]].concat();
    let mut child = folder.command(&args).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("starts");
    let mut stderr = BufReader::new(child.stderr.take().expect("piped"));
    // The first line of progress comes when the model has been read.
    let mut text = String::new();
    stderr.read_line(&mut text).expect("reads");
    for model in ["ball.glb", "ball2.glb"] {
        fs::remove_file(folder.path(model)).expect("removes");
    }
    stderr.read_to_string(&mut text).expect("reads");
    assert_eq!(child.wait().expect("ends").code(), Some(1), "{text}");
    assert!(text.contains("note: the model was deleted or renamed meanwhile"), "{text}");
    assert!(text.contains("ball2.glb: import: cannot read the file: there is no such file; check the path"), "{text}");
    assert!(folder.path("lods/ball.glb").exists() && folder.path("lods/ball_turntable.png").exists());
}

#[test]
fn patterns_are_expanded_by_the_command() {
    let folder = Folder::new().with("in/a.glb", triangle()).with("in/b.glb", triangle()).with("in/c.txt", "text");
    let run = folder.bake(&["in/*.glb"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(folder.path("lods/a.glb").exists() && folder.path("lods/b.glb").exists());
    let run = folder.bake(&["in/*.gltf"]);
    assert_eq!(run.code, 2);
    run.says("in/*.gltf: no .glb or .gltf file and no folder matches");
}
