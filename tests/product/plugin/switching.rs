//! What is seen of a baked model.

use std::collections::BTreeSet;
use std::fs;

use serde_json::{Value, json};

use super::model::{glb, globe};
use super::project::Project;

/// Three globes with origins five metres apart, in one file.
fn three_globes() -> Vec<u8> {
    let (mut json, bin) = globe(40);
    for key in ["textures", "images"] {
        json.as_object_mut().expect("an object").remove(key);
    }
    json["materials"] = json!([{}]);
    json["buffers"][0].as_object_mut().expect("an object").remove("uri");
    json["nodes"] = json!([-5, 0, 5].map(|x| json!({ "mesh": 0, "translation": [x, 0, 0] })));
    json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    glb(&json, bin)
}

#[test]
fn source_and_levels_are_seen_together_only_while_they_fade() {
    let project = Project::new();
    project.save("assets/globes.glb", three_globes());
    let mut game = project.run_with("scene: Some(CameraMovesAway)");
    let (mut seen, mut fades) = (Vec::new(), BTreeSet::new());
    loop {
        let report = game.wait("the smallest level alone", |r| r["what"] == "ranges");
        let parts: Vec<(u64, u64)> = report["parts"]
            .as_object()
            .expect("an object")
            .iter()
            .map(|(level, parts)| (level.parse().expect("a number"), parts.as_u64().expect("a number")))
            .collect();
        // The source comes in three parts, each level in one, and never in less.
        assert!(parts.iter().all(|&(level, n)| n == if level == 0 { 3 } else { 1 }), "{report}");
        match parts[..] {
            [(level, _)] => seen.push(level),
            // Two neighbours in detail: the source and the largest level, or that and the next.
            [(0, _), (2, _)] | [(1, _), (2, _)] => {
                fades.insert((parts[0].0, parts[1].0));
            }
            _ => panic!("{report}"),
        }
        if seen.last() == Some(&1) {
            break;
        }
    }
    seen.dedup();
    assert_eq!(seen, [0, 2, 1]);
    assert_eq!(fades, BTreeSet::from([(0, 2), (1, 2)]));
    game.quit();
}

#[test]
fn levels_move_with_the_joints_of_their_source_in_every_frame_of_a_clip() {
    let project = Project::new();
    let octopus = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/octopus.glb")).expect("in the repository");
    project.save("assets/octopus.glb", octopus);
    let mut game = project.run_with("scene: Some(ClipPlays)");
    game.wait_for_levels("octopus.glb", 2);
    let is_posed = |r: &Value| r["what"] == "joints" && r["levels"] == 2;
    let (mut poses, mut seen, mut frames) = (BTreeSet::new(), BTreeSet::new(), 2);
    while (seen.len() as u64) < frames {
        let report = game.wait("joints", is_posed);
        assert!(report["apart"].as_f64().expect("finite") < 1e-6, "{report}");
        frames = report["frames"].as_u64().expect("a number");
        seen.insert(report["frame"].as_u64());
        poses.insert(report["pose"].to_string());
    }
    assert!(poses.len() * 2 > seen.len(), "the clip does not play: {} poses in {} frames", poses.len(), seen.len());
    game.quit();
}
