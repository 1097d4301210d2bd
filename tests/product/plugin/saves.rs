//! The ways in which files are saved while the game runs.

use std::fs;
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::model::{globe, globe_glb, heavy_glb, png};
use super::project::{Game, Project};

fn running(rings: u32) -> (Project, Game) {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(rings));
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 2);
    (project, game)
}

#[test]
fn ten_saves_in_a_second_are_one_bake() {
    let (project, mut game) = running(40);
    let loaded = game.count("loaded");
    for i in 0..10 {
        project.save("assets/ball.glb", globe_glb(42 + i));
        sleep(Duration::from_millis(100));
    }
    game.wait_for_levels("ball.glb", 0);
    game.wait_for_levels("ball.glb", 2);
    game.listen(Duration::from_secs(1));
    assert_eq!((game.count("started"), game.count("finished"), game.count("loaded")), (2, 2, loaded + 2));
    game.quit();
}

/// Blender, vim and most others write a new file and rename it.
#[test]
fn a_version_that_is_renamed_into_place_is_seen() {
    let (project, mut game) = running(40);
    let [model, temporary] = ["assets/ball.glb", "assets/ball.glb.tmp"].map(|path| project.path(path));
    let mut next = 42;
    let mut ways: [(&str, Box<dyn FnMut(&[u8])>); 4] = [
        (
            "at once",
            Box::new(|glb| {
                fs::write(&temporary, glb).expect("writes");
                fs::rename(&temporary, &model).expect("renames");
            }),
        ),
        (
            "after the new file was seen",
            Box::new(|glb| {
                fs::write(&temporary, glb).expect("writes");
                sleep(Duration::from_millis(1500));
                fs::rename(&temporary, &model).expect("renames");
            }),
        ),
        (
            "from elsewhere",
            Box::new(|glb| {
                project.save("ball.glb", glb);
                fs::rename(project.path("ball.glb"), &model).expect("renames");
            }),
        ),
        (
            "with the old one as a backup",
            Box::new(|glb| {
                let backup = project.path("assets/ball.glb~");
                fs::rename(&model, &backup).expect("renames");
                fs::write(&model, glb).expect("writes");
                fs::remove_file(backup).expect("removes");
            }),
        ),
    ];
    for (way, save) in &mut ways {
        let started = game.count("started");
        save(&globe_glb(next));
        next += 2;
        game.wait_for_levels("ball.glb", 0);
        game.wait_for_levels("ball.glb", 2);
        assert_eq!((game.count("started"), game.count("load failed")), (started + 1, 0), "{way}");
    }
    drop(ways);
    game.quit();
}

#[test]
fn files_saved_together_are_one_bake() {
    let project = Project::new();
    let save = |rings, colour| {
        let ((json, bin), png) = (globe(rings), png(colour));
        project.save("assets/globe.gltf", json.to_string());
        project.save("assets/globe.bin", bin);
        project.save("assets/globe.png", png);
    };
    save(40, [200, 30, 30]);
    let mut game = project.run();
    game.wait_for_levels("globe.gltf", 2);
    save(44, [30, 30, 200]);
    game.wait_for_levels("globe.gltf", 2);
    game.listen(Duration::from_secs(2));
    game.assert_counts(&[("started", 2), ("finished", 2), ("failed", 0)]);
    game.quit();
}

#[test]
fn an_outdated_bake_stops() {
    let project = Project::new();
    // Minutes of work.
    project.save(
        "config/simpliguard.ron",
        "(defaults: (faces: [4000], quality: Best, views: 64, view_size: 512, texture_size: 64, normal_map: false))",
    );
    project.save("assets/ball.glb", globe_glb(200));
    // On a busy machine a bake that stands back would not even get to see that it is outdated.
    let mut game = project.run();
    game.wait_for("started", "ball.glb");
    game.listen(Duration::from_secs(3));
    let saved = Instant::now();
    project.save("assets/ball.glb", globe_glb(204));
    game.wait_for("started", "ball.glb");
    let seconds = saved.elapsed().as_secs_f64();
    // A third of a second until the change is seen, a second for the bake; the rest is for busy machines.
    assert!(seconds < 5.0, "{seconds} s");
    assert_eq!((game.count("finished"), game.count("failed")), (0, 0));
    game.kill();
}

fn saved_twice(megabytes: usize) {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(40));
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 2);
    let [one, two] = [1, 2].map(|fill| heavy_glb(40, megabytes, fill));
    project.save("assets/ball.glb", one);
    sleep(Duration::from_millis(100));
    project.save("assets/ball.glb", two);
    game.wait_for_levels("ball.glb", 2);
    game.listen(Duration::from_secs(1));
    game.assert_counts(&[("failed", 0), ("load failed", 0)]);
    game.quit();
}

#[test]
fn a_large_model_saved_again_at_once() {
    saved_twice(40);
}

#[test]
fn a_large_model_saved_while_it_is_processed() {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(40));
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 2);
    for fill in [1, 2] {
        project.save("assets/ball.glb", heavy_glb(40, 40, fill));
        sleep(Duration::from_millis(700));
    }
    project.save("assets/ball.glb", globe_glb(44));
    game.wait("the small one again", |r| r["what"] == "finished" && r["triangles"] == 2 * 44 * 44 - 44);
    game.wait_for_levels("ball.glb", 2);
    game.assert_counts(&[("failed", 0), ("load failed", 0)]);
    game.quit();
}

#[test]
#[ignore = "writes gigabytes"]
fn a_model_of_500_megabytes_saved_again_at_once() {
    saved_twice(500);
}
