//! Levels with morph targets.

use super::*;

/// [`two_bones`] and its levels, whose one target lifts the last vertex by one.
fn morphing(weight: f32) -> (Model, [Level; 3]) {
    let mut model = two_bones(Some(0));
    let target = MorphTarget { name: "lift".into(), weight, displacements: vec![(2, Vec3::Y)] };
    model.surface.morphs = Some(Morphs { node: 3, targets: vec![target] });
    let morph = LevelMorph { positions: vec![Vec3::ZERO, Vec3::ZERO, Vec3::Y], normals: vec![Vec3::ZERO; 3] };
    let levels = levels(true).map(|mut level| {
        level.mesh.morphs = vec![morph.clone()];
        level
    });
    (model, levels)
}

/// Samplers of the channels that weight a node's targets, one clip after the other.
fn weighted_by(read: &Read, node: &Value) -> Vec<Value> {
    let clips = read.json["animations"].as_array().expect("clips").iter();
    let channels = clips.flat_map(|clip| clip["channels"].as_array().expect("channels"));
    let own = channels.filter(|c| c["target"]["node"] == *node && c["target"]["path"] == "weights");
    own.map(|channel| channel["sampler"].clone()).collect()
}

#[test]
fn morphing_levels_are_weighted_like_the_source() {
    let (model, levels) = morphing(0.0);
    for (params, source) in [(ExportParams::default(), "Keep"), (drop_source(), "Drop")] {
        let name = format!("morphing_{source}");
        let read = Read::new(&name, &export(&model, &levels, &params).expect("exports"));
        let nodes = read.json["nodes"].as_array().expect("nodes");
        let meshes = read.json["meshes"].as_array().expect("meshes");
        let is_level = |mesh: &Value| mesh["extras"]["targetNames"] == json!(["lift"]);
        assert_eq!(meshes.iter().filter(|mesh| is_level(mesh)).count(), 3);
        let levels = (0..nodes.len())
            .filter(|&n| nodes[n]["mesh"].as_u64().is_some_and(|mesh| is_level(&meshes[mesh as usize])));
        let levels: Vec<usize> = levels.collect();
        // Each level stands beside the source, and in a scene of its own.
        assert_eq!(levels.len(), 6);
        assert!(levels.iter().all(|n| weighted_by(&read, &json!(n)).len() == 2), "{name}");
        let target = &meshes[meshes.len() - 1]["primitives"][0]["targets"][0];
        // The joints are twice as large as the space the vertices are bound in.
        let lifted = read.floats(&target["POSITION"], 3);
        assert!((lifted.iter().copied().fold(0.0, f32::max) - 0.5).abs() < 1e-6, "{lifted:?}");
        assert_eq!(read.floats(&target["NORMAL"], 3).len(), 9);
    }
}

#[test]
fn a_morphing_level_alone_keeps_its_clips() {
    let (model, levels) = morphing(0.0);
    let read = Read::new("morphing_alone", &export_level(&model, &levels[0]).expect("exports"));
    let node = read.json["nodes"].as_array().expect("nodes").iter().position(|n| n.get("mesh").is_some());
    assert_eq!(weighted_by(&read, &json!(node.expect("a level"))).len(), 2);
}

#[test]
fn default_weights_of_morph_targets_stay_out_of_the_vertices() {
    let highest = |weight: f32| {
        let (model, levels) = morphing(weight);
        let read = Read::new("morphed", &export_level(&model, &levels[0]).expect("exports"));
        assert_eq!(read.json["meshes"][0]["weights"], json!([weight]));
        let positions = read.floats(&read.attributes(0)["POSITION"], 3);
        positions.iter().copied().fold(f32::MIN, f32::max)
    };
    // Half a unit in the space that the joints double.
    assert!((highest(0.0) - highest(1.0) - 0.5).abs() < 1e-6);
}
