//! What is baked when, and what the game shows meanwhile.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::time::Duration;

use image::{ImageFormat, Rgb, RgbImage};
use serde_json::json;

use super::model::{globe, globe_glb, png};
use super::project::{Project, files_below};

/// A model in three files.
fn with_globe() -> Project {
    let project = Project::new();
    let (json, bin) = globe(40);
    project.save("assets/globe.gltf", json.to_string());
    project.save("assets/globe.bin", bin);
    project.save("assets/globe.png", png([200, 30, 30]));
    project
}

fn with_ball() -> Project {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(40));
    project
}

#[test]
fn the_model_comes_at_once_and_its_levels_follow() {
    let project = with_globe();
    let mut game = project.run();
    game.wait_for_levels("globe.gltf", 0);
    game.wait_for("finished", "globe.gltf");
    game.wait_for_levels("globe.gltf", 2);
    assert_eq!((game.count("started"), game.count("failed")), (1, 0));
    game.assert_rising_progress("globe.gltf");
    game.quit();
    let processed = fs::read(project.path("imported_assets/Default/globe.gltf")).expect("processed");
    assert!(processed.starts_with(b"glTF"));

    let mut second = project.run();
    second.wait_for("loaded", "globe.gltf");
    second.wait_for("instance", "globe.gltf");
    second.quit_without_bakes();

    // Another checkout of the project with the same cache bakes nothing either.
    fs::remove_dir_all(project.path("imported_assets")).expect("removes");
    let mut third = project.run();
    third.wait_for("loaded", "globe.gltf");
    third.quit_without_bakes();
}

/// Bevy reads no compressed geometry, and WebP only with a feature. The game shows the models decoded.
#[test]
fn compressed_models_come_at_once_too() {
    let project = Project::new();
    let (globe, bin) = globe(40);
    project.save("assets/globe.bin", bin);
    project.save("assets/globe.png", png([200, 30, 30]));
    let mut webp = Cursor::new(Vec::new());
    RgbImage::from_pixel(4, 4, Rgb([200, 30, 30])).write_to(&mut webp, ImageFormat::WebP).expect("an image");
    project.save("assets/globe.webp", webp.into_inner());

    let (mut draco, mut plain) = (globe.clone(), globe);
    draco["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    plain["images"] = json!([{ "uri": "globe.webp" }]);
    let mut extended = plain.clone();
    extended["textures"] = json!([{ "extensions": { "EXT_texture_webp": { "source": 0 } } }]);
    let files = [("draco.gltf", draco), ("plain.gltf", plain), ("extended.gltf", extended)];
    for (name, file) in &files {
        project.save(&format!("assets/{name}"), file.to_string());
    }
    let mut game = project.run();
    let shown = RefCell::new(BTreeSet::new());
    game.wait("each model without and with levels", |r| {
        if r["what"] == "loaded" {
            shown.borrow_mut().insert((r["path"].to_string(), r["levels"].to_string()));
        }
        shown.borrow().len() == 2 * files.len()
    });
    assert_eq!((game.count("started"), game.count("load failed")), (files.len(), 0));
    game.quit();
}

/// Textures of source and levels lie in blocks where the game imports them, unless a setting says otherwise.
#[test]
fn textures_of_a_processed_file_lie_in_blocks() {
    let in_blocks = |settings: &str| {
        let project = with_globe();
        let process = format!("Process(processor: \"bevy_simpliguard::SimpliguardProcess\", settings: ({settings}))");
        project.save("assets/globe.gltf.meta", format!("(meta_format_version: \"1.0\", asset: {process})"));
        let mut game = project.run();
        game.wait_for("finished", "globe.gltf");
        game.wait_for_levels("globe.gltf", 2);
        game.quit();
        let processed = fs::read(project.path("imported_assets/Default/globe.gltf")).expect("processed");
        let file = gltf::Gltf::from_slice(&processed).expect("glTF");
        let is_in_blocks = |image: gltf::Image<'_>| image.extras().as_ref().is_some_and(|e| e.get().contains("bc7"));
        file.images().map(is_in_blocks).collect::<Vec<bool>>()
    };
    let (by_default, off) = (in_blocks(""), in_blocks("texture_compression: Off"));
    assert!(by_default.len() > 1 && by_default.iter().all(|is_in_blocks| *is_in_blocks), "{by_default:?}");
    assert!(off.len() == by_default.len() && !off.contains(&true), "{off:?}");
}

/// A source on demand is a file beside the processed ones, which a game loads for a camera that is near.
#[test]
fn a_source_on_demand_comes_with_a_camera_and_goes_with_it() {
    let project = with_globe();
    let process =
        "Process(processor: \"bevy_simpliguard::SimpliguardProcess\", settings: (source: OnDemand, materials: Baked))";
    project.save("assets/globe.gltf.meta", format!("(meta_format_version: \"1.0\", asset: {process})"));
    let mut game = project.run();
    game.wait_for_levels("globe.gltf", 2);
    game.quit();
    let sources = files_below(&project.path("imported_assets/on_demand/globe.gltf"));
    let [source, level] = &sources[..] else { panic!("{sources:?}") };
    assert!(level.to_string_lossy().ends_with("_LOD2.glb"), "{sources:?}");
    let size = |path: &Path| fs::metadata(path).expect("it is there").len();
    let levels = project.path("imported_assets/Default/globe.gltf");
    assert!(size(&levels) < size(source), "{} {}", size(&levels), size(source));

    let mut second = project.run_with("scene: Some(CameraMovesAway)");
    second.wait("the source", |r| r["what"] == "sources" && r["resident"] == 1);
    second.wait("no source", |r| r["what"] == "sources" && r["resident"] == 0);
    assert_eq!(second.reported("sources").expect("reported")["failed"], 0);
    second.quit_without_bakes();
    assert_eq!(files_below(&project.path("imported_assets/on_demand")), sources);

    // With another setting the source is in the processed file again, from the same bake.
    project.save(
        "assets/globe.gltf.meta",
        format!("(meta_format_version: \"1.0\", asset: {})", process.replace("OnDemand", "Keep")),
    );
    let mut third = project.run();
    third.wait_for_levels("globe.gltf", 2);
    third.quit_without_bakes();
    assert!(size(&levels) > size(source));
}

#[test]
fn bakes_in_processes_of_their_own_give_the_same_levels() {
    let levels = |options: &str| {
        let project = with_globe();
        let mut game = project.run_with(options);
        game.wait_for("finished", "globe.gltf");
        game.wait_for_levels("globe.gltf", 2);
        game.assert_rising_progress("globe.gltf");
        game.assert_not_logged("it is baked in this process");
        game.quit();
        fs::read(project.path("imported_assets/Default/globe.gltf")).expect("processed")
    };
    assert!(levels("isolate: true") == levels("isolate: false"));
}

#[test]
fn a_saved_texture_gives_new_levels() {
    let project = with_globe();
    let mut game = project.run();
    game.wait_for_levels("globe.gltf", 2);
    let before = fs::read(project.path("imported_assets/Default/globe.gltf")).expect("processed");
    project.save("assets/globe.png", png([30, 30, 200]));
    game.wait_for("started", "globe.gltf");
    game.wait_for_levels("globe.gltf", 2);
    assert_ne!(before, fs::read(project.path("imported_assets/Default/globe.gltf")).expect("processed"));
    game.quit();
}

#[test]
fn a_saved_buffer_gives_new_levels() {
    let project = with_globe();
    let mut game = project.run();
    let size = game.wait_for_levels("globe.gltf", 2)["size"].as_f64().expect("a number");
    // Positions come first.
    let (json, mut bin) = globe(40);
    let positions = json["bufferViews"][0]["byteLength"].as_u64().expect("a number") as usize;
    for number in bin[..positions].chunks_exact_mut(4) {
        let half = 0.5 * f32::from_le_bytes(number.try_into().expect("four bytes"));
        number.copy_from_slice(&half.to_le_bytes());
    }
    project.save("assets/globe.bin", bin);
    game.wait_for("started", "globe.gltf");
    let halved = game.wait_for_levels("globe.gltf", 2)["size"].as_f64().expect("a number");
    assert!((halved / size - 0.5).abs() < 0.02, "{size} became {halved}");
    game.quit();
}

/// Bevy has the files that a model names processed too; the model is baked from what they were.
#[test]
fn textures_are_taken_as_they_are_saved() {
    let bake = |options| {
        let project = with_globe();
        let mut game = project.run_with(options);
        game.wait_for_levels("globe.gltf", 2);
        game.quit();
        let processed = |name| fs::read(project.path("imported_assets/Default").join(name)).expect("processed");
        (processed("globe.png"), processed("globe.gltf"))
    };
    let (picture, model) = bake("");
    let (blackened, same_model) = bake("blacken_pictures: true");
    assert!(picture != blackened, "pictures are not processed");
    assert!(model == same_model);
}

#[test]
fn a_saved_texture_is_on_the_levels_before_they_are_refined() {
    let project = with_globe();
    project.save(
        "config/simpliguard.ron",
        "(defaults: (faces: [100, 200], candidates: Source, views: 8, view_size: 128, texture_size: 64, refine_steps: 600))",
    );
    let mut game = project.run();
    game.wait_for("finished", "globe.gltf");
    game.wait_for_levels("globe.gltf", 2);
    project.save("assets/globe.png", png([30, 30, 200]));
    game.wait_for("started", "globe.gltf");
    game.wait_for_levels("globe.gltf", 2);
    assert_eq!(game.count("finished"), 1, "the bake still runs");
    game.wait_for("finished", "globe.gltf");
    game.wait_for_levels("globe.gltf", 2);
    game.quit();
}

#[test]
fn saved_settings_give_new_levels_and_a_mistake_in_them_costs_none_of_the_model() {
    let meta = |settings: &str| {
        format!(
            "(meta_format_version: \"1.0\",\n asset: Process(processor: \"bevy_simpliguard::SimpliguardProcess\",\n \
             settings: ({settings})))"
        )
    };
    let project = with_ball();
    project.save("assets/ball.glb.meta", meta("faces: [100, 200, 400]"));
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 3);
    project.save("assets/ball.glb.meta", meta("faces: [150]"));
    game.wait_for_levels("ball.glb", 1);
    project.save("assets/ball.glb.meta", meta("fces: [150]"));
    let failed = game.wait_for("failed", "ball.glb");
    assert_eq!(failed["error"], "settings: ball.glb.meta:3:13: unknown field 'fces'; did you mean 'faces'?");
    game.wait_for_levels("ball.glb", 0);
    project.save("assets/ball.glb.meta", meta("faces: [150]"));
    game.wait_for_levels("ball.glb", 1);
    assert_eq!(game.count("started"), 2);
    game.quit();
}

#[test]
fn saved_project_settings_reach_every_model() {
    let project = with_ball();
    project.save("assets/more/ball.glb", globe_glb(50));
    let mut game = project.run();
    let both = ["ball.glb", "more/ball.glb"];
    game.wait_for_each("finished", &both);
    let text = fs::read_to_string(project.path("config/simpliguard.ron")).expect("reads");
    project.save("config/simpliguard.ron", text.replace("[100, 200]", "[120]"));
    game.wait_for_each("finished", &both);
    assert_eq!(game.count("started"), 4);

    // A rule that reaches one of them has that one baked.
    let text = text.replace("[100, 200]", "[120]");
    let rule = "rules: [(glob: \"more/**\", settings: (faces: [130]))])";
    project.save("config/simpliguard.ron", text.strip_suffix(')').expect("RON").to_owned() + ", " + rule);
    game.wait_for("finished", "more/ball.glb");
    game.listen(Duration::from_secs(1));
    assert_eq!(game.count("started"), 5);
    game.quit();
}

#[test]
fn a_saved_model_is_baked_again_and_a_broken_one_leaves_the_last_good() {
    let project = with_ball();
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 2);
    let good = globe_glb(44);
    project.save("assets/ball.glb", &good);
    game.wait_for("finished", "ball.glb");
    game.wait_for_levels("ball.glb", 2);
    let processed = project.path("imported_assets/Default/ball.glb");
    let levels = fs::read(&processed).expect("processed");

    let broken = &good[..good.len() / 2];
    project.save("assets/ball.glb", broken);
    game.wait_for_failure_and_levels("ball.glb", "ball.glb: import: ", 2);
    assert_eq!(levels, fs::read(&processed).expect("processed"));
    game.quit();
    assert_eq!(fs::read(project.path("assets/ball.glb")).expect("reads"), broken);

    // Still broken at the next start.
    let mut second = project.run();
    second.wait_for_failure_and_levels("ball.glb", "ball.glb: import: ", 2);
    project.save("assets/ball.glb", &good);
    second.wait_for_levels("ball.glb", 2);
    assert_eq!((second.count("finished"), second.count("load failed"), second.fewest_levels()), (0, 0, 2));
    second.quit();
}

/// Bevy drops all that it has processed when a file fails twice.
#[test]
fn a_model_that_is_broken_again_and_again_costs_others_nothing() {
    let project = with_ball();
    project.save("assets/other.glb", globe_glb(44));
    let mut game = project.run();
    game.wait_for_each("finished", &["ball.glb", "other.glb"]);
    for length in [500, 400] {
        project.save("assets/ball.glb", &globe_glb(40)[..length]);
        game.wait_for("failed", "ball.glb");
    }
    game.quit();
    let processed = project.path("imported_assets/Default/other.glb");
    let written = || fs::metadata(&processed).and_then(|file| file.modified()).expect("processed");
    let before = written();
    let mut second = project.run();
    second.wait_for_levels("other.glb", 2);
    assert_eq!((second.count("started"), written()), (0, before));
    second.quit();
}

#[test]
fn a_game_killed_while_it_bakes_bakes_at_the_next_start() {
    let project = with_ball();
    project.save(
        "assets/ball.glb.meta",
        "(meta_format_version: \"1.0\", asset: Process(processor: \"SimpliguardProcess\", settings: (faces: [1000], \
         candidates: Reconstruction, resolution: Cells(64))))",
    );
    let mut game = project.run();
    game.wait_for_start_and_levels("ball.glb", 0);
    game.kill();
    assert!(files_below(&project.path("cache/simpliguard-v1/results")).is_empty());

    let mut second = project.run();
    second.wait_for_levels("ball.glb", 0);
    second.wait_for_levels("ball.glb", 1);
    assert_eq!(second.count("started"), 1);
    second.quit();
    let mut third = project.run();
    third.wait_for("loaded", "ball.glb");
    third.quit_without_bakes();
}

#[test]
fn a_blocking_game_sees_nothing_but_levels() {
    let project = with_globe();
    let mut game = project.run_with("blocking: true");
    game.wait_for("instance", "globe.gltf");
    assert_eq!((game.count("started"), game.fewest_levels()), (1, 2));
    game.quit();
}

#[test]
fn files_may_come_after_the_model_that_names_them() {
    let project = Project::new();
    let (json, bin) = globe(40);
    project.save("assets/globe.gltf", json.to_string());
    let mut game = project.run();
    let failed = game.wait_for("failed", "globe.gltf");
    assert!(failed["error"].as_str().expect("text").contains("globe.bin"), "{failed}");
    project.save("assets/globe.png", png([200, 30, 30]));
    project.save("assets/globe.bin", bin);
    game.wait_for_levels("globe.gltf", 2);
    game.quit();
}

#[test]
fn names_with_several_dots_are_models_too() {
    let project = Project::new();
    project.save("assets/hero.v2.glb", globe_glb(40));
    let mut game = project.run();
    game.wait_for_levels("hero.v2.glb", 2);
    game.quit();
}

#[test]
fn a_model_that_ended_the_game_twice_is_left_as_it_is_until_it_changes() {
    let project = with_ball();
    let settings = |steps: u32| {
        format!(
            "(defaults: (faces: [100, 200], candidates: Source, views: 8, view_size: 128, texture_size: 64, refine_steps: \
             {steps}))"
        )
    };
    project.save("config/simpliguard.ron", settings(2000));
    for _ in 0..2 {
        let mut game = project.run();
        game.wait_for("started", "ball.glb");
        game.kill();
    }
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 0);
    if game.count("failed") == 0 {
        game.wait_for("failed", "ball.glb");
    }
    let error = game.reported("failed").and_then(|failed| failed["error"].as_str()).expect("a text");
    assert!(error.starts_with("ball.glb: import: 2 bakes of this model have ended with a crash"), "{error}");
    project.save("config/simpliguard.ron", settings(10));
    game.wait_for_levels("ball.glb", 2);
    game.quit();
    // A game that ends as it should, or another that bakes the same, blames no model.
    project.save("config/simpliguard.ron", settings(1999));
    for _ in 0..3 {
        let mut game = project.run();
        game.wait_for("started", "ball.glb");
        assert_eq!(game.count("failed"), 0);
        game.quit();
    }
}
