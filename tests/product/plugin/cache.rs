//! A cache that others use too, or that is of no use.

use std::fs;

use super::model::globe_glb;
use super::project::Project;

#[test]
fn two_games_with_one_cache_bake_a_model_once() {
    let first = Project::new();
    let second = Project::with_cache(&first.path("cache"));
    for project in [&first, &second] {
        project.save("assets/ball.glb", globe_glb(60));
    }
    let mut games = [first.run(), second.run()];
    for game in &mut games {
        game.wait_for_levels("ball.glb", 2);
    }
    assert_eq!(games.iter().map(|game| game.count("started")).sum::<usize>(), 1);
    let files = [&first, &second].map(|p| fs::read(p.path("imported_assets/Default/ball.glb")).expect("processed"));
    assert!(files[0] == files[1]);
    for game in games {
        game.quit();
    }
}

#[test]
fn a_cache_that_is_deleted_while_the_game_runs_is_made_again() {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(40));
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 2);
    for (bakes, rings) in [(2, 44), (3, 40)] {
        fs::remove_dir_all(project.path("cache")).expect("removes");
        project.save("assets/ball.glb", globe_glb(rings));
        game.wait_for_levels("ball.glb", 0);
        game.wait_for_levels("ball.glb", 2);
        assert_eq!((game.count("started"), game.count("failed")), (bakes, 0));
    }
    assert!(project.path("cache").is_dir());
    game.quit();
}

#[test]
fn a_cache_that_cannot_be_written_costs_nothing_but_time() {
    let beside = Project::new();
    beside.save("file", "");
    let project = Project::with_cache(&beside.path("file/cache"));
    project.save("assets/ball.glb", globe_glb(40));
    let mut game = project.run();
    game.wait_for_levels("ball.glb", 2);
    game.wait_for_log("the result is not kept");
    assert_eq!((game.count("started"), game.count("failed")), (1, 0));
    game.quit();
    // What was processed needs no cache.
    let mut second = project.run();
    second.wait_for_levels("ball.glb", 2);
    second.quit_without_bakes();
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_model_as_it_is() {
    let project = Project::new();
    let model = globe_glb(40);
    let kib = model.len() as u64 / 1024 + 8;
    project.save("assets/ball.glb", &model);
    let mut game = project.run_on_full_disk(kib);
    game.wait_for_levels("ball.glb", 0);
    let failed = game.wait_for("failed", "ball.glb");
    assert!(
        failed["error"].as_str().expect("text").contains("ball.glb: the levels cannot be put in place"),
        "{failed}"
    );
    game.quit();
    assert_eq!(fs::read(project.path("imported_assets/Default/ball.glb")).expect("reads"), model);

    // Room again.
    let mut second = project.run();
    second.wait_for_levels("ball.glb", 2);
    second.quit();
}
