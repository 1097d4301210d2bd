//! Scenes whose objects are baked: each kind once, and only what has changed.

#![expect(clippy::print_stdout, reason = "a measurement")]

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

use bytes::Bytes;
use serde_json::{Value, json};
use simpliguard::settings::{
    AtlasSize, BakeOverrides, BakeSettings, Budgets, Candidates, ExistingLods, LevelMaterials, ObjectRule, Quality,
    Scope,
};
use simpliguard::{Context, PreviewSink, RelativeUri, Report, Resources, Source, Status};
use simpliguard_bake::{CachedBake, Host, Notice, Parts};
use simpliguard_cache::Cache;

/// Fast, whatever it looks like.
fn settings() -> BakeSettings {
    BakeSettings {
        scope: Scope::Objects,
        candidates: Candidates::Source,
        texture_size: 64.into(),
        views: 8,
        view_size: 128,
        normal_map: false,
        refine: false,
        poses: 0,
        warn_below: 0.0,
        ..BakeSettings::preset(Quality::Draft)
    }
}

/// A scene file in the making: its nodes and meshes, and the one buffer of these.
#[derive(Clone, Default)]
struct Scene {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    bin: Vec<u8>,
}

impl Scene {
    /// Adds a ball of `4 * rings * rings` triangles with bumps. Those at one pole, `2 * rings`, have no area. Returns its mesh.
    fn ball(&mut self, rings: u32, bumps: f32) -> usize {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let sides = 2 * rings;
        for (i, j) in (0..=rings).flat_map(|i| (0..=sides).map(move |j| (i, j))) {
            let theta = std::f32::consts::PI * i as f32 / rings as f32;
            let phi = std::f32::consts::TAU * j as f32 / sides as f32;
            let radius = 1.0 + 0.1 * (bumps * theta).sin() * (3.0 * phi).cos();
            positions.extend([theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()].map(|x| radius * x));
        }
        let corner = |i: u32, j: u32| i * (sides + 1) + j;
        for (i, j) in (0..rings).flat_map(|i| (0..sides).map(move |j| (i, j))) {
            let [a, b, c, d] = [corner(i, j), corner(i, j + 1), corner(i + 1, j), corner(i + 1, j + 1)];
            triangles.extend([a, b, c, b, d, c]);
        }
        let bytes = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
        let bits: Vec<u32> = positions.iter().map(|x| x.to_bits()).collect();
        let bounds = json!({ "min": [-1.2, -1.2, -1.2], "max": [1.2, 1.2, 1.2], "type": "VEC3" });
        let positions = self.accessor(&bytes(&bits), 5126, positions.len() / 3, bounds);
        let indices = self.accessor(&bytes(&triangles), 5125, triangles.len(), json!({ "type": "SCALAR" }));
        let primitive = json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": 0 });
        self.meshes.push(json!({ "primitives": [primitive] }));
        self.meshes.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, mut about: Value) -> usize {
        self.views.push(json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() }));
        self.bin.extend(bytes);
        about["bufferView"] = json!(self.views.len() - 1);
        about["componentType"] = json!(component);
        about["count"] = json!(count);
        self.accessors.push(about);
        self.accessors.len() - 1
    }

    fn node(&mut self, node: Value) -> usize {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    fn gltf(&self) -> Vec<u8> {
        let children: Vec<u64> = self
            .nodes
            .iter()
            .filter_map(|node| node.get("children")?.as_array())
            .flatten()
            .filter_map(Value::as_u64)
            .collect();
        let roots: Vec<usize> = (0..self.nodes.len()).filter(|node| !children.contains(&(*node as u64))).collect();
        let document = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": roots }], "nodes": self.nodes,
            "meshes": self.meshes, "accessors": self.accessors, "bufferViews": self.views,
            "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [0.8, 0.4, 0.2, 1], "metallicFactor": 0 } }],
            "buffers": [{ "uri": "scene.bin", "byteLength": self.bin.len() }],
        });
        document.to_string().into_bytes()
    }
}

impl Resources for Scene {
    fn read(&self, _: &RelativeUri) -> Result<Bytes, String> {
        Ok(Bytes::from(self.bin.clone()))
    }
}

/// Notes which objects are baked, and which are found.
#[derive(Default)]
struct Recorder {
    objects: RefCell<BTreeMap<bool, Vec<String>>>,
}

impl Host for Recorder {
    fn notify(&self, notice: Notice) {
        panic!("{notice}");
    }

    fn object(&self, name: &str, is_cached: bool) {
        self.objects.borrow_mut().entry(is_cached).or_default().push(name.to_owned());
    }
}

/// The scene with its levels.
struct Baked {
    glb: Vec<u8>,
    document: Value,
    report: Report,
    /// The objects that were baked.
    baked: Vec<String>,
    found: usize,
}

fn bake(scene: &Scene, cache: &Cache) -> Baked {
    bake_with(scene, cache, &settings())
}

fn bake_with(scene: &Scene, cache: &Cache, settings: &BakeSettings) -> Baked {
    bake_in(scene, cache, settings, &Context::default())
}

fn bake_in(scene: &Scene, cache: &Cache, settings: &BakeSettings, context: &Context<'_>) -> Baked {
    let (bytes, host) = (scene.gltf(), Recorder::default());
    let source = Source { name: "village.gltf", bytes: &bytes, resources: scene };
    let bake = CachedBake::new(source, settings, Parts::Combined, Some(cache)).expect("a glTF");
    let outcome = bake.run(context, &host).expect("bakes");
    let glb = outcome.result.combined;
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let document = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let mut objects = host.objects.into_inner();
    let baked = objects.remove(&false).unwrap_or_default();
    let found = objects.remove(&true).unwrap_or_default().len();
    Baked { glb, document, report: outcome.result.report, baked, found }
}

impl Baked {
    /// The level nodes of an object: number of the level, mesh and translation.
    fn levels_of(&self, object: usize) -> Vec<(u64, u64, Value)> {
        let nodes = self.document["nodes"].as_array().expect("nodes");
        let stamp =
            |node: &Value| node.pointer("/extras/simpliguard").filter(|stamp| stamp["object"] == object).cloned();
        let level =
            |node: &Value| Some((stamp(node)?["level"].as_u64()?, node["mesh"].as_u64()?, node["translation"].clone()));
        nodes.iter().filter_map(level).collect()
    }
}

/// Twelve instances of three meshes: moved, turned, scaled and mirrored.
fn village() -> Scene {
    let mut scene = Scene::default();
    let meshes = [(10, 2.0), (12, 3.0), (8, 5.0)].map(|(rings, bumps)| scene.ball(rings, bumps));
    for i in 0..12 {
        let scale = if i % 4 == 3 { [-1.0, 1.0, 2.0] } else { [1.0, 1.0 + i as f32, 1.0] };
        let name = format!("ball.{i:03}");
        scene.node(json!({ "name": name, "mesh": meshes[i % 3], "translation": [3 * i, 0, 1], "scale": scale }));
    }
    scene
}

#[test]
fn each_kind_of_object_is_baked_once() {
    let dir = tempfile::tempdir().expect("tempdir");
    let baked = bake(&village(), &Cache::new(dir.path()));
    assert_eq!(baked.baked, ["village.gltf: ball.000", "village.gltf: ball.001", "village.gltf: ball.002"]);
    assert_eq!((baked.report.status, baked.report.source_faces), (Status::Baked, 4 * (400 + 576 + 256)));
    let objects: Vec<_> = baked.report.objects.iter().map(|o| (o.instances, o.source_faces, o.levels.len())).collect();
    assert_eq!(objects, [(4, 380, 3), (4, 552, 3), (4, 240, 3)]);
    for node in 0..12 {
        let levels = baked.levels_of(node);
        assert_eq!(levels.iter().map(|level| level.0).collect::<Vec<_>>(), [3, 2, 1]);
        assert!(levels.iter().all(|level| level.2 == json!([3 * node, 0, 1])), "{levels:?}");
        let meshes = |node| baked.levels_of(node).into_iter().map(|level| level.1).collect::<Vec<_>>();
        assert_eq!(meshes(node), meshes(node % 3), "instances share their meshes");
        let lods = &baked.document["nodes"][node];
        assert_eq!(lods["extensions"]["MSFT_lod"]["ids"].as_array().map(Vec::len), Some(3));
        assert_eq!(lods["extras"]["MSFT_screencoverage"].as_array().map(Vec::len), Some(4));
    }
    assert_eq!(baked.document["meshes"].as_array().map(Vec::len), Some(3 + 9));
}

#[test]
fn only_what_has_changed_is_baked_again() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    assert_eq!(bake(&village(), &cache).baked.len(), 3);
    let mut moved = village();
    moved.nodes[4]["translation"] = json!([0, 7, 0]);
    let baked = bake(&moved, &cache);
    assert_eq!((baked.baked.len(), baked.found, &baked.levels_of(4)[0].2), (0, 3, &json!([0, 7, 0])));
    let mut more = moved.clone();
    let prop = more.ball(9, 4.0);
    more.node(json!({ "name": "prop", "mesh": prop }));
    let baked = bake(&more, &cache);
    assert_eq!((&baked.baked[..], baked.found), (&["village.gltf: prop".to_owned()][..], 3));
    let mut changed = more.clone();
    let other = changed.ball(10, 2.5);
    changed.nodes.iter_mut().filter(|node| node["mesh"] == 0).for_each(|node| node["mesh"] = json!(other));
    let baked = bake(&changed, &cache);
    assert_eq!((&baked.baked[..], baked.found), (&["village.gltf: ball.000".to_owned()][..], 3));
}

#[test]
fn thousands_of_objects_take_seconds() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    let mut scene = village();
    for i in 12..5000 {
        scene.node(json!({ "name": format!("ball.{i}"), "mesh": i % 3, "translation": [i, 0, 2] }));
    }
    assert_eq!(bake(&scene, &cache).baked.len(), 3);
    scene.nodes[4999]["translation"] = json!([0, 7, 0]);
    let start = std::time::Instant::now();
    let baked = bake(&scene, &cache);
    let seconds = start.elapsed().as_secs_f32();
    println!("5,000 objects, all from the cache: {seconds:.2} s");
    assert_eq!((baked.baked.len(), baked.found, baked.levels_of(4999).len()), (0, 3, 3));
    assert!(seconds < 30.0, "{seconds} s");
}

#[test]
fn another_file_shares_what_is_equal() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    bake(&village(), &cache);
    let mut other = Scene::default();
    other.ball(3, 1.0);
    let (first, again) = (other.ball(12, 3.0), other.ball(12, 3.0));
    other.node(json!({ "mesh": first }));
    other.node(json!({ "mesh": again }));
    let baked = bake(&other, &cache);
    assert_eq!((baked.baked.len(), baked.found), (0, 1));
    assert_eq!(baked.report.objects[0].instances, 2, "two equal meshes of one file are one kind");
    assert_eq!(baked.levels_of(0)[0].1, baked.levels_of(1)[0].1);
}

#[test]
fn a_group_is_one_object_and_small_things_stay() {
    let dir = tempfile::tempdir().expect("tempdir");
    let mut scene = Scene::default();
    let (globe, pebble) = (scene.ball(8, 2.0), scene.ball(4, 1.0));
    for lamp in ["Lamp.1", "Lamp.2"] {
        let parts = [0, 1].map(|y| scene.node(json!({ "mesh": globe, "translation": [0, 3 * y, 0] })));
        scene.node(json!({ "name": lamp, "children": parts, "translation": [scene.nodes.len(), 0, 0] }));
    }
    scene.node(json!({ "name": "pebble", "mesh": pebble }));
    let objects = vec![simpliguard::settings::NodePattern("Lamp*".into())];
    let baked = bake_with(&scene, &Cache::new(dir.path()), &BakeSettings { objects, ..settings() });
    assert_eq!(baked.baked, ["village.gltf: Lamp.1"]);
    assert_eq!((baked.levels_of(2).len(), baked.levels_of(5).len(), baked.levels_of(6).len()), (3, 3, 0));
    let report = &baked.report.objects[0];
    assert_eq!((report.instances, report.source_faces), (2, 480));
}

#[test]
fn one_level_stands_for_the_whole_scene() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    let with_whole = BakeSettings { whole: Budgets(vec![80, 200]), ..settings() };
    let plain = bake(&village(), &cache);
    let baked = bake_with(&village(), &cache, &with_whole);
    assert_eq!((baked.baked.len(), baked.found), (0, plain.baked.len()), "the objects have the keys that they had");
    let stamps = |baked: &Baked| -> Vec<Value> {
        let nodes = baked.document["nodes"].as_array().expect("nodes").iter();
        let stamps = nodes.filter_map(|node| node.pointer("/extras/simpliguard").cloned());
        stamps.filter(|stamp| stamp.get("whole").is_some()).collect()
    };
    assert_eq!(stamps(&plain).len(), 0);
    let [large, small] = &stamps(&baked)[..] else { panic!("two levels") };
    assert_eq!((&large["budget"], &small["budget"]), (&json!(200), &json!(80)));
    assert!(large["faces"].as_u64() <= Some(200) && large["error"].as_f64() < small["error"].as_f64());
    let mesh_nodes = village().nodes.len();
    assert_eq!((&small["replaces"], small.get("object")), (&json!((0..mesh_nodes).collect::<Vec<_>>()), None));
    assert_eq!(baked.report.levels.iter().map(|level| level.budget).collect::<Vec<_>>(), [80, 200]);
    // A chair that was moved changes the level of the whole, and no object.
    let mut moved = village();
    moved.nodes[0]["translation"] = json!([40, 0, 0]);
    let again = bake_with(&moved, &cache, &with_whole);
    assert_eq!((again.baked.len(), again.found), (0, plain.baked.len()));
    assert_ne!(stamps(&again)[1]["error"], small["error"]);
}

/// What was shown.
#[derive(Default)]
struct Previews(Mutex<Vec<Vec<u8>>>);

impl PreviewSink for Previews {
    fn show(&self, glb: Vec<u8>) {
        self.0.lock().expect("not poisoned").push(glb);
    }
}

#[test]
fn levels_of_objects_are_shown_before_the_one_of_the_whole_is_made() {
    let (dir, previews) = (tempfile::tempdir().expect("tempdir"), Previews::default());
    let cache = Cache::new(dir.path());
    let shared_atlas = AtlasSize::Texels(256);
    let plain = BakeSettings { shared_atlas, materials: LevelMaterials::Baked, ..settings() };
    let with_whole = BakeSettings { whole: Budgets(vec![80]), ..plain.clone() };
    let context = Context { preview: Some(&previews), ..Context::default() };
    let baked = bake_in(&village(), &cache, &with_whole, &context);
    let shown = previews.0.into_inner().expect("not poisoned");
    assert!(shown == [bake_with(&village(), &cache, &plain).glb], "{} previews", shown.len());
    assert!(baked.glb == bake_with(&village(), &cache, &with_whole).glb, "a preview changed the result");
}

#[test]
fn the_smallest_levels_share_one_material() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    let own_materials = BakeSettings { materials: LevelMaterials::Baked, ..settings() };
    let plain = bake_with(&village(), &cache, &own_materials);
    let with_atlas = BakeSettings { shared_atlas: AtlasSize::Texels(256), ..own_materials };
    let baked = bake_with(&village(), &cache, &with_atlas);
    assert_eq!((baked.baked.len(), baked.found), (0, plain.baked.len()), "the objects have the keys that they had");
    let materials = |baked: &Baked, smallest: bool| -> BTreeSet<u64> {
        let nodes = baked.document["nodes"].as_array().expect("nodes").iter();
        let stamped =
            nodes.filter_map(|node| Some((node.pointer("/extras/simpliguard/level")?.as_u64()?, &node["mesh"])));
        let meshes = stamped.filter(|(level, _)| (*level == 1) == smallest).filter_map(|(_, mesh)| mesh.as_u64());
        let material = |mesh: u64| baked.document["meshes"][mesh as usize]["primitives"][0]["material"].as_u64();
        meshes.filter_map(material).collect()
    };
    assert_eq!(materials(&plain, true).len(), plain.baked.len());
    assert_eq!(materials(&baked, true).len(), 1);
    assert_eq!(materials(&baked, false).len(), materials(&plain, false).len());
    assert!(materials(&baked, true).is_disjoint(&materials(&baked, false)));
}

#[test]
fn levels_that_keep_the_materials_of_objects_show_those_of_the_scene() {
    let dir = tempfile::tempdir().expect("tempdir");
    let baked = bake(&village(), &Cache::new(dir.path()));
    assert!(baked.report.all_levels().any(|level| level.candidate == "reduction"), "{:?}", baked.report);
    let count = |kind: &str| baked.document[kind].as_array().map_or(0, Vec::len);
    let kept = |node: &Value| node.pointer("/extras/simpliguard/materials").cloned();
    let nodes = baked.document["nodes"].as_array().expect("nodes");
    let keeping: Vec<&Value> = nodes.iter().filter(|node| kept(node).is_some()).collect();
    assert!(!keeping.is_empty());
    for node in keeping {
        let mesh = node["mesh"].as_u64().expect("a mesh") as usize;
        assert_eq!(baked.document["meshes"][mesh]["primitives"][0]["material"], 0, "the scene's only one");
        assert_eq!(kept(node), Some(json!([0])));
    }
    assert!(count("images") <= baked.report.all_levels().filter(|level| level.candidate != "reduction").count());
}

/// Two rocks with a level of their own, and a bush with one of two meshes.
fn with_own_levels() -> Scene {
    let mut scene = Scene::default();
    let [rock, simple, bush, half] = [(12, 3.0), (7, 3.0), (8, 5.0), (4, 5.0)].map(|(rings, b)| scene.ball(rings, b));
    for copy in ["", ".001"] {
        let x = 3 * scene.nodes.len();
        for (level, mesh) in [rock, simple].into_iter().enumerate() {
            scene.node(json!({ "name": format!("Rock_LOD{level}{copy}"), "mesh": mesh, "translation": [x, 0, 1] }));
        }
    }
    scene.node(json!({ "name": "Bush", "mesh": bush, "translation": [0, 0, 9] }));
    let halves = [0, 1].map(|_| scene.node(json!({ "mesh": half })));
    scene.node(json!({ "name": "Bush_LOD1", "children": halves, "translation": [0, 0, 9] }));
    scene
}

#[test]
fn objects_keep_their_own_levels_and_get_smaller_ones() {
    let dir = tempfile::tempdir().expect("tempdir");
    let baked = bake(&with_own_levels(), &Cache::new(dir.path()));
    assert_eq!(baked.baked, ["village.gltf: Rock_LOD0", "village.gltf: Bush"]);
    for (rock, translation) in [(0, json!([0, 0, 1])), (2, json!([6, 0, 1]))] {
        let levels = baked.levels_of(rock);
        assert_eq!(levels.iter().map(|level| level.0).collect::<Vec<_>>(), [2, 1]);
        assert_eq!((levels[0].1, &levels[0].2), (1, &translation), "the mesh of the file, in the place of the object");
        assert!(baked.document["nodes"][rock + 1].get("mesh").is_none(), "it is not shown on top of its object");
    }
    assert_eq!(baked.levels_of(4).len(), 3);
    assert!([5, 6].iter().all(|half: &usize| baked.document["nodes"][*half].get("mesh").is_none()));
    let rock = &baked.report.objects[0];
    assert_eq!((rock.instances, rock.levels.len(), rock.own_levels.len()), (2, 1, 1));
    assert_eq!((rock.levels[0].budget, rock.own_levels[0].faces), (72, 196));
    assert!((0.001..0.05).contains(&rock.own_levels[0].error), "{rock:?}");
    let note = baked.report.notes.iter().find(|note| note.contains("own levels"));
    assert!(note.is_some_and(|note| note.starts_with("1 of the file's own levels")), "{:?}", baked.report.notes);
}

#[test]
fn own_levels_are_replaced_on_request() {
    let dir = tempfile::tempdir().expect("tempdir");
    let cache = Cache::new(dir.path());
    let replace = BakeSettings { existing_lods: ExistingLods::Replace, ..settings() };
    let baked = bake_with(&with_own_levels(), &cache, &replace);
    assert_eq!((baked.levels_of(0).len(), baked.levels_of(2).len(), baked.levels_of(4).len()), (3, 3, 3));
    assert!(baked.report.objects.iter().all(|object| object.own_levels.is_empty()));
    assert!(baked.document["nodes"][1].get("mesh").is_none());
    // They are no part of the surface of a whole scene either.
    let baked =
        bake_with(&with_own_levels(), &cache, &BakeSettings { scope: Scope::Scene, faces: vec![90], ..replace });
    assert_eq!(baked.report.status, Status::Baked);
    // A ring of tiny triangles at a pole has no area left where the second rock stands.
    assert!((2 * 528 + 240..=2 * 552 + 240).contains(&baked.report.source_faces), "{}", baked.report.source_faces);
    let level = |node: &&Value| node.pointer("/extras/simpliguard/replaces") == Some(&json!([0, 2, 4]));
    assert_eq!(baked.document["nodes"].as_array().expect("nodes").iter().filter(level).count(), 1);
    assert!([1, 3, 5, 6].iter().all(|node: &usize| baked.document["nodes"][*node].get("mesh").is_none()));
}

#[test]
fn rules_reach_the_objects_that_they_name() {
    let dir = tempfile::tempdir().expect("tempdir");
    let rule = |node: &str, settings| ObjectRule { node: node.to_owned(), settings };
    let object_rules = vec![
        rule("ball.00[36]", BakeOverrides { faces: Some(vec![60]), ..BakeOverrides::default() }),
        rule("*.001", BakeOverrides { enabled: Some(false), ..BakeOverrides::default() }),
    ];
    let baked = bake_with(&village(), &Cache::new(dir.path()), &BakeSettings { object_rules, ..settings() });
    let levels: Vec<usize> = (0..12).map(|node| baked.levels_of(node).len()).collect();
    assert_eq!(levels, [3, 0, 3, 1, 3, 3, 1, 3, 3, 3, 3, 3]);
    let objects: Vec<_> = baked.report.objects.iter().map(|o| (o.name.as_str(), o.instances, o.levels.len())).collect();
    let expected = [("ball.000", 2, 3), ("ball.001", 1, 0), ("ball.002", 4, 3), ("ball.003", 2, 1), ("ball.004", 3, 3)];
    assert_eq!(objects, expected);
    assert!(baked.report.objects[3].levels[0].faces <= 60);
}

#[test]
fn an_object_that_cannot_be_baked_keeps_its_mesh() {
    let dir = tempfile::tempdir().expect("tempdir");
    let mut scene = village();
    // Beyond the end of the buffer.
    scene.views[1]["byteLength"] = json!(1);
    let baked = bake(&scene, &Cache::new(dir.path()));
    assert_eq!((baked.baked.len(), baked.levels_of(0).len(), baked.levels_of(1).len()), (2, 0, 3));
    let note = &baked.report.notes[0];
    assert!(note.starts_with("an object gets no levels: village.gltf: ball.000: import: "), "{note}");
}
