//! Times of a running game, printed and not judged: they depend on the machine.
//!
//! ```sh
//! cargo test --test product -- --ignored --nocapture --test-threads=1 figures
//! ```

#![expect(clippy::print_stdout, reason = "the figures")]

use std::time::{Duration, Instant};

use super::model::{globe, globe_glb, globe_glb_coloured, heavy_glb, png};
use super::project::{Game, Project};
use crate::village;

/// Time from the start of a game until it shows 1,000 models whose files are those of its last start.
fn warm_start(options: &str) -> f64 {
    let project = Project::new();
    for i in 0..1000 {
        project.save(&format!("assets/{:02}/{i:03}.glb", i / 100), globe_glb_coloured(4, i as f32 / 1000.0));
    }
    let all = |r: &serde_json::Value| r["what"] == "all loaded";
    let mut first = project.run_with(options);
    first.wait("all models", all);
    if options.is_empty() {
        first.wait("all models baked", |r| r["what"] == "settled" && r["models"] == 1000);
    }
    first.quit();
    let best = (0..3).map(|_| {
        let mut game = project.run_with(options);
        let seconds = game.wait("all models", all)["t"].as_f64().expect("seconds");
        assert_eq!(game.count("started"), 0);
        game.quit();
        seconds
    });
    best.fold(f64::INFINITY, f64::min)
}

#[test]
#[ignore = "a figure"]
fn figures_start_with_1000_unchanged_models() {
    let [without, with] = ["plain: true", ""].map(warm_start);
    println!("1,000 unchanged models: {with:.2} s, without the plugin {without:.2} s");
}

#[test]
#[ignore = "a figure"]
fn figures_saved_texture() {
    let project = Project::new();
    let save = |colour| project.save("assets/globe.png", png(colour));
    let (json, bin) = globe(100);
    project.save("assets/globe.gltf", json.to_string());
    project.save("assets/globe.bin", bin);
    save([200, 30, 30]);
    // All that a bake has by default, at a size that does not take for ever.
    project.save("config/simpliguard.ron", "(defaults: (faces: [500, 1000], texture_size: 256, views: 32))");
    let mut game = project.run();
    let cold = game.wait_for("finished", "globe.gltf")["seconds"].as_f64().expect("seconds");
    game.wait_for_levels("globe.gltf", 2);
    game.listen(Duration::from_secs(3));
    let saved = Instant::now();
    save([30, 30, 200]);
    game.wait_for_levels("globe.gltf", 0);
    let passed = saved.elapsed().as_secs_f64();
    game.wait_for_levels("globe.gltf", 2);
    let shown = saved.elapsed().as_secs_f64();
    let baked = game.wait_for("finished", "globe.gltf")["seconds"].as_f64().expect("seconds");
    game.wait_for_levels("globe.gltf", 2);
    let refined = saved.elapsed().as_secs_f64();
    println!(
        "a saved texture: new pixels after {passed:.2} s, on levels after {shown:.2} s, refined after {refined:.2} s"
    );
    let part = |seconds: f64| 100.0 * seconds / cold;
    println!(
        "of a first bake, the new one took {:.0} %; the levels were there after {:.0} %",
        part(baked),
        part(shown)
    );
    game.quit();
}

/// Settings with which the objects of a scene get two levels, and a third stands for all of them.
const OBJECTS: &str = "(defaults: (scope: Objects, faces: [100, 200], whole: [1000], quality: Draft, candidates: Source, \
                       views: 8, view_size: 128, texture_size: 64, normal_map: false))";

/// Waits until the village is there with levels of its objects, and with one for all of them or without. Returns when.
fn wait_for_village(game: &mut Game, has_whole: bool) -> Instant {
    game.wait(if has_whole { "a level for all objects" } else { "levels of objects" }, |r| {
        let has = |levels: &str| r[levels].as_u64() > Some(0);
        r["what"] == "loaded" && has("levels of objects") && has("levels of all") == has_whole
    });
    game.wait("an instance", |r| r["what"] == "instance");
    Instant::now()
}

#[test]
#[ignore = "a figure"]
fn figures_saved_scene() {
    let project = Project::new();
    project.save("config/simpliguard.ron", OBJECTS);
    let glb = village::write(&project.path("assets"));
    std::fs::remove_file(project.path("assets").join(format!("{}.meta", village::FILE))).expect("was written");
    let mut game = project.run();
    let mut print_times = |what: &str, begin: Instant| {
        let [of_objects, of_all] =
            [false, true].map(|has_whole| (wait_for_village(&mut game, has_whole) - begin).as_secs_f64());
        println!("{what}: levels of objects after {of_objects:.2} s, one for all of them after {of_all:.2} s");
        game.listen(Duration::from_secs(3));
    };
    print_times("a scene of 300 objects and 20 meshes", Instant::now());
    let changes =
        [("a moved object", village::with_moved_object(&glb)), ("a changed mesh", village::with_changed_mesh(&glb))];
    for (what, glb) in changes {
        let saved = Instant::now();
        project.save(&format!("assets/{}", village::FILE), glb);
        print_times(what, saved);
    }
    game.quit();
}

#[test]
#[ignore = "a figure"]
fn figures_one_large_model() {
    let project = Project::new();
    project.save("assets/ball.glb", heavy_glb(40, 500, 1));
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 2);
    let end = game.quit();
    println!("500 MB: longest frame {:.0} ms", 1000.0 * end["worst_frame"].as_f64().expect("seconds"));
}

/// Time from a save to the start of the next bake, with the one before at work for a while longer each time.
fn save_to_next_start(rings: u32, options: &str) {
    let project = Project::new();
    project.save("config/simpliguard.ron", "()");
    project.save("assets/ball.glb", globe_glb(rings));
    let mut game = project.run_with(options);
    game.wait_for("started", "ball.glb");
    let times: Vec<f64> = (1..=12)
        .map(|i| {
            game.listen(Duration::from_millis(300 + 650 * u64::from(i)));
            let (saved, finished) = (Instant::now(), game.count("finished"));
            project.save("assets/ball.glb", globe_glb(rings + i));
            game.wait_for("started", "ball.glb");
            assert_eq!(game.count("finished"), finished, "the bake was done before its turn came");
            saved.elapsed().as_secs_f64()
        })
        .collect();
    let (mean, worst) = (times.iter().sum::<f64>() / times.len() as f64, times.iter().copied().fold(0.0, f64::max));
    println!(
        "{} triangles, {options}: from a save to the next bake {mean:.2} s, longest {worst:.2} s",
        2 * rings * rings
    );
    game.kill();
}

#[test]
#[ignore = "a figure"]
fn figures_outdated_bakes() {
    for rings in [160, 400] {
        for options in ["priority: Low", "priority: Normal"] {
            save_to_next_start(rings, options);
        }
    }
}

/// Shortest frame in milliseconds.
const FRAME: f64 = 16.7;
/// Time of the GPU in a frame of the game alone, in milliseconds, at least.
const DRAWING: f64 = 4.0;

/// Frame times of a game that draws, and of its bake.
fn frames_of_drawing(balls: u32, frame: f64, options: &str) -> (f64, String) {
    let project = Project::new();
    project.save("config/simpliguard.ron", "()");
    let is_plain = options.contains("plain");
    if !is_plain {
        project.save("assets/octopus.glb", include_bytes!("../../../assets/octopus.glb"));
    }
    let drawing = format!("drawing: Some((balls: {balls})), work: Some((milliseconds: 0, frame: {frame}))");
    let mut game = project.run_with(&format!("{drawing}, {options}"));
    if is_plain {
        game.listen(Duration::from_secs(4));
    } else {
        game.wait_for("finished", "octopus.glb");
    }
    let bake = game.reported("finished").map_or(0.0, |report| report["seconds"].as_f64().expect("seconds"));
    let times = &game.quit()[if is_plain { "alone" } else { "baking" }];
    // Without an end of the start there are no figures.
    let ms = |what: &str| times[what].as_f64().unwrap_or(f64::INFINITY);
    let (mean, most, worst) = (ms("mean"), ms("p95"), ms("worst"));
    (mean, format!("mean {mean:.1} ms, 95 % {most:.1} ms, longest {worst:.0} ms; bake of {bake:.1} s"))
}

#[test]
#[ignore = "a figure; needs a GPU"]
fn figures_frame_times_beside_a_bake_on_the_gpu() {
    let mut balls = 30;
    while frames_of_drawing(balls, 0.0, "plain: true").0 < DRAWING && balls < 100_000 {
        balls *= 2;
    }
    for options in ["plain: true", "gpu: false", "gpu: true, gpu_ms: Some(1000)", "gpu: true"] {
        let times = frames_of_drawing(balls, FRAME, options).1;
        println!("{balls} balls, {options:<30}: {times}");
    }
}

/// Frame times of a game that works on both of two cores for 8 ms a frame, and how far its bake came.
fn frame_times(frame: f64, options: &str) {
    let project = Project::new();
    project.save("config/simpliguard.ron", "()");
    project.save("assets/ball.glb", globe_glb(120));
    let mut game = project.run_with(&format!("work: Some((milliseconds: 8, frame: {frame})), {options}"));
    let is_plain = options.contains("plain");
    let mut seconds = 0;
    while seconds < 60 && game.count("finished") == 0 && (!is_plain || seconds < 10) {
        game.listen(Duration::from_secs(1));
        seconds += 1;
    }
    let baked = game.reported("finished").map(|report| report["seconds"].as_f64().expect("seconds"));
    let end = game.quit();
    let times = &end[if is_plain { "alone" } else { "baking" }];
    let bake = match baked {
        _ if is_plain => "no bake".to_owned(),
        Some(seconds) => format!("bake of {seconds:.1} s"),
        None => "no end of the bake within 60 s".to_owned(),
    };
    println!(
        "at least {frame:>4} ms a frame, {options:<32}: mean {:.1} ms, 95 % {:.1} ms, longest {:.0} ms; {bake}",
        times["mean"].as_f64().expect("frames"),
        times["p95"].as_f64().expect("frames"),
        times["worst"].as_f64().expect("frames"),
    );
}

#[test]
#[ignore = "a figure"]
fn figures_frame_times_beside_a_bake() {
    // Sixty frames a second, half of both cores; as many as there can be, all of them.
    for frame in [16.7, 0.0] {
        for options in [
            "plain: true",
            "threads: Some(1), priority: Lowest",
            "threads: Some(1), priority: Low",
            "threads: Some(1), priority: Normal",
            "threads: Some(2), priority: Lowest",
            "threads: Some(2), priority: Low",
            "threads: Some(2), priority: Normal",
        ] {
            frame_times(frame, options);
        }
    }
}
