//! Several games on one asset folder.

use std::fs;
use std::time::Duration;

use super::model::globe_glb;
use super::project::Project;

const REFUSAL: &str = "assets are not processed and no levels are baked: another game processes the same assets";

#[test]
fn a_second_game_shows_what_the_first_makes() {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(40));
    let mut first = project.run();
    first.wait_for_levels("ball.glb", 2);
    let log = fs::read(project.path("imported_assets/log")).expect("reads");

    let mut second = project.run();
    second.wait_for_log(REFUSAL);
    second.wait_for_levels("ball.glb", 2);
    assert_eq!(log, fs::read(project.path("imported_assets/log")).expect("reads"));
    project.save("assets/ball.glb", globe_glb(44));
    first.wait_for_levels("ball.glb", 0);
    first.wait_for_levels("ball.glb", 2);
    second.wait_for_levels("ball.glb", 0);
    second.wait_for_levels("ball.glb", 2);
    assert_eq!((first.count("started"), second.count("started")), (2, 0));

    // Nobody takes the place of the first while the second runs, but whoever comes next does.
    first.quit();
    project.save("assets/ball.glb", globe_glb(48));
    second.listen(Duration::from_secs(1));
    let mut third = project.run();
    third.wait_for_levels("ball.glb", 2);
    second.wait_for_levels("ball.glb", 2);
    assert_eq!((third.count("started"), second.count("started")), (1, 0));
    second.quit();
    third.quit();
}

#[test]
fn a_second_game_may_come_before_there_is_anything_to_show() {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(40));
    let mut first = project.run_with("blocking: true");
    first.wait_for("started", "ball.glb");
    let mut second = project.run();
    second.wait_for_log(REFUSAL);
    second.wait_for_levels("ball.glb", 2);
    first.quit();
    second.quit();
}

#[test]
fn a_game_after_one_that_was_killed_processes() {
    let project = Project::new();
    project.save("assets/ball.glb", globe_glb(40));
    let mut first = project.run();
    first.wait_for_levels("ball.glb", 0);
    first.kill();
    let mut second = project.run();
    second.wait_for_levels("ball.glb", 2);
    second.quit();
}
