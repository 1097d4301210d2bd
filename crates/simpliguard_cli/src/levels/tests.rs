//! Levels of single models and of scenes.

use bytes::Bytes;
use serde_json::{Value, json};
use simpliguard::data::Document;

use super::*;

fn names(levels: &[Level]) -> Vec<&str> {
    levels.iter().map(|level| level.name.as_str()).collect()
}

#[test]
fn levels_of_a_single_model_are_found_by_their_nodes() {
    let document = json!({
        "scenes": [{"nodes": [3]}],
        "nodes": [
            {"mesh": 0, "extras": {"simpliguard": "other"}},
            {"mesh": 7, "skin": 1, "extras": {"simpliguard": {"level": 2, "budget": 20, "faces": 19, "error": 0.5}}},
            {"extras": {"simpliguard": {"level": 1}}},
            {"mesh": 5, "skin": 0, "children": [0, 2]},
        ],
    });
    let levels = Levels::of(&document);
    assert_eq!((names(&levels.all), &levels.source, levels.kinds.len()), (vec!["LOD1", "LOD2"], &vec![0, 3], 0));
    let (first, second) = (&levels.all[0], &levels.all[1]);
    assert_eq!((&first.nodes, &second.nodes), (&vec![2], &vec![1]));
    assert_eq!((second.level, second.budget, second.faces, second.error), (2, Some(20), Some(19), Some(0.5)));
    assert!(Levels::of(&json!({})).all.is_empty());
    // A level is hung beside the source, unless it stands in the scene.
    let attached = |nodes: &[usize]| attach(&mut document.clone(), nodes);
    assert_eq!((attached(&[1]), attached(&[2])), (Some(vec![3, 1]), Some(vec![3])));
}

/// Two chairs, one of them turned, a table with one level, and a floor without levels. The meshes have 8, 6, 4 and 1
/// triangles, the levels 1 and 2 of a chair 2 and 3, that of the table 2, the whole 1.
fn scene() -> Value {
    let triangles = [8, 6, 4, 2, 3, 2, 1];
    let mesh = |i: usize| json!({"name": format!("mesh {i}"), "primitives": [{"attributes": {"POSITION": i}}]});
    let level = |(mesh, level, object): (usize, u64, usize)| {
        json!({"mesh": mesh, "translation": [object, 0, 0],
            "extras": {"simpliguard": {"level": level, "object": object, "space": object, "replaces": [object]}}})
    };
    let levels = [(4, 2, 0), (3, 1, 0), (4, 2, 1), (3, 1, 1), (5, 1, 2)];
    let mut nodes = vec![
        json!({"mesh": 0, "name": "Chair"}),
        json!({"mesh": 0, "name": "Chair.001", "translation": [1, 0, 0]}),
        json!({"mesh": 1, "translation": [2, 0, 0]}),
        json!({"mesh": 2, "name": "Floor"}),
    ];
    nodes.extend(levels.map(level));
    nodes.push(json!({"mesh": 6, "extras": {"simpliguard": {"level": 1, "whole": true, "replaces": [0, 1, 2, 3]}}}));
    json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0, 1, 2, 3]}], "nodes": nodes, "meshes": (0..7).map(mesh).collect::<Vec<_>>(),
        "accessors": triangles.map(|n| json!({"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3 * n})),
        "bufferViews": [{"buffer": 0, "byteLength": 24 * 36}], "buffers": [{"byteLength": 24 * 36}],
    })
}

#[test]
fn levels_of_a_scene_are_the_whole_ones_and_those_of_all_objects() {
    let levels = Levels::of(&scene());
    assert_eq!(names(&levels.all), ["whole LOD1", "LOD1 of all objects", "LOD2 of all objects"]);
    assert_eq!(levels.source, [0, 1, 2, 3]);
    let shown: Vec<_> = levels.all.iter().map(|level| (level.level, level.nodes.clone(), level.faces)).collect();
    // The table has no second level, and the floor none: they show their sources.
    assert_eq!(
        shown,
        [(1, vec![9], None), (1, vec![3, 5, 7, 8], Some(2 + 2 + 2 + 4)), (2, vec![2, 3, 4, 6], Some(6 + 4 + 3 + 3))]
    );
}

#[test]
fn objects_with_the_same_levels_are_one_kind() {
    let kinds = Levels::of(&scene()).kinds;
    let found: Vec<_> = kinds.iter().map(|k| (k.name.as_str(), k.instances, k.triangles, k.nodes.clone())).collect();
    assert_eq!(found, [("Chair", 2, Some(8), vec![0]), ("mesh 1", 1, Some(6), vec![2])]);
    let levels: Vec<_> = kinds[0].levels.iter().map(|level| (level.name.as_str(), level.nodes.clone())).collect();
    assert_eq!(levels, [("LOD1", vec![5]), ("LOD2", vec![4])]);
}

#[test]
fn the_finest_levels_stand_for_a_source_that_was_dropped() {
    let mut scene = scene();
    for node in 0..3 {
        scene["nodes"][node].as_object_mut().expect("a node").remove("mesh");
    }
    let levels = Levels::of(&scene);
    assert_eq!(levels.source, [3, 4, 6, 8]);
    assert_eq!((&levels.all[1].nodes, &levels.all[2].nodes), (&vec![3, 5, 7, 8], &vec![3, 4, 6, 8]));
    assert_eq!((levels.kinds[1].name.as_str(), levels.kinds[1].triangles), ("node 2", None));
}

#[test]
fn a_level_follows_the_space_that_it_lies_in() {
    let mut scene = scene();
    let roots = attach(&mut scene, &[3, 5, 9]);
    assert_eq!(roots, Some(vec![0, 1, 2, 3, 9]));
    assert_eq!(scene["nodes"][0]["children"], json!([5]));
    assert_eq!(scene["nodes"][5].get("translation"), None);
}

#[test]
fn a_part_is_imported_with_its_own_triangles_only() {
    // Triangles along x, in steps of one.
    let corners = (0..24u8).flat_map(|i| [[i, 0, 0], [i + 1, 0, 0], [i, 1, 0]]).flatten();
    let buffer: Vec<u8> = corners.flat_map(|x| f32::from(x).to_le_bytes()).collect();
    let document = Document { json: scene(), buffers: vec![Bytes::from(buffer)], ..Document::default() };
    let levels = Levels::of(&document.json);
    let import = |nodes: &[usize]| {
        let part = Part { document: &document, nodes, drawn: Instances::All };
        let surface = part.import("scene").expect("a part").surface;
        let farthest = surface.positions.iter().map(|p| p.x).fold(0.0, f32::max);
        (surface.triangles.len(), farthest)
    };
    assert_eq!(import(&levels.all[0].nodes), (1, 1.0));
    // The first level of the second chair is as far from the origin as the chair.
    assert_eq!(import(&[7]), (2, 3.0));
    assert_eq!(import(&levels.kinds[1].nodes), (6, 8.0));
}
