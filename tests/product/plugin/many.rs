//! Many models at once.

use super::model::globe_glb_coloured;
use super::project::Project;

/// A small bake.
const TINY: &str = "(defaults: (faces: [40], quality: Draft, candidates: Source, views: 8, view_size: 128, texture_size: 64, \
                    normal_map: false), plugin: (threads: 2))";

#[test]
fn two_hundred_models_at_once() {
    let project = Project::new();
    project.save("config/simpliguard.ron", TINY);
    for i in 0..200 {
        project.save(&format!("assets/{i:03}.glb"), globe_glb_coloured(6, i as f32 / 200.0));
    }
    let mut game = project.run();
    game.wait("all of them", |r| r["what"] == "settled" && r["models"] == 200);
    assert_eq!((game.count("started"), game.count("finished"), game.count("failed")), (200, 200, 0));
    #[cfg(target_os = "linux")]
    {
        let (memory, threads) = (game.proc_status("VmHWM") / 1024, game.own_threads());
        assert!(memory < 400, "{memory} MiB");
        // Two that compute, one that brings them work, one that listens to changes.
        assert_eq!(threads, 4);
    }
    game.quit();
}
