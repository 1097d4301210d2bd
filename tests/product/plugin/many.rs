//! Many models at once.

use std::time::{Duration, Instant};

use super::model::globe_glb_coloured;
use super::project::{PATIENCE, Project};

/// A small bake.
const TINY: &str = "(defaults: (faces: [40], quality: Draft, candidates: Source, views: 8, view_size: 128, texture_size: 64, \
                    normal_map: false), plugin: (threads: 2))";

/// Less than one for each model.
#[cfg(target_os = "linux")]
const MOST_THREADS: usize = 200;

#[test]
fn two_hundred_models_at_once() {
    let project = Project::new();
    project.save("config/simpliguard.ron", TINY);
    for i in 0..200 {
        project.save(&format!("assets/{i:03}.glb"), globe_glb_coloured(6, i as f32 / 200.0));
    }
    let mut game = project.run();
    let start = Instant::now();
    #[cfg(target_os = "linux")]
    let mut most_threads = 0;
    while game.reported("settled").is_none_or(|r| r["models"] != 200) {
        assert!(start.elapsed() < PATIENCE, "{} bakes in {:?}", game.count("finished"), start.elapsed());
        game.listen(Duration::from_millis(20));
        #[cfg(target_os = "linux")]
        {
            most_threads = most_threads.max(game.threads(""));
        }
    }
    assert_eq!((game.count("started"), game.count("finished"), game.count("failed")), (200, 200, 0));
    #[cfg(target_os = "linux")]
    {
        let (memory, threads) = (game.proc_status("VmHWM") / 1024, game.threads("simpliguard"));
        assert!(memory < 400, "{memory} MiB");
        // Two that compute, one that brings them work, one that listens to changes.
        assert_eq!(threads, 4);
        assert!(most_threads < MOST_THREADS, "{most_threads} threads");
    }
    game.quit();
}
