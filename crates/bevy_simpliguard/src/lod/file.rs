//! The levels in a baked file, by what their nodes say in `extras.simpliguard`: those of the whole scene, which `MSFT_lod`
//! of one node lists, or those of each object, and those that stand for all objects.

use std::collections::{BTreeMap, HashMap, HashSet};

use bevy::log::{debug, warn};
use bevy::math::Mat4;
use gltf::json::{Value, deserialize};
use gltf::mesh::Mode;
use serde::Deserialize;

/// The levels of a file, and its document.
pub(super) struct LodFile {
    pub(super) document: gltf::Document,
    /// The transforms from the space of each node to the scene, in the rest pose.
    pub(super) rest: Vec<Mat4>,
    /// The parent of each node, and its name among its siblings.
    names: Vec<(Option<usize>, String)>,
    /// Not empty. One group for the whole scene, or one for each object, and behind them the one that stands for all.
    pub(super) groups: Vec<FileGroup>,
    /// The groups, by the mesh of the level that tells their bounds.
    pub(super) by_mesh: HashMap<usize, Vec<usize>>,
    /// Materials of levels that are seen mirrored.
    pub(super) mirrored: HashSet<usize>,
}

/// What levels stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Of {
    /// A scene without objects.
    Scene,
    /// One object of a scene.
    Object,
    /// All objects of a scene.
    AllObjects,
}

/// Levels that switch together.
pub(super) struct FileGroup {
    /// Index of the node that holds the levels: that of the object, or the one with `MSFT_lod`.
    pub(super) holder: usize,
    pub(super) of: Of,
    /// The node in whose space the levels lie; `None` for the space of the scene.
    pub(super) space: Option<usize>,
    /// Indices of the nodes whose meshes the levels stand for.
    pub(super) replaces: Vec<usize>,
    /// The levels in falling detail. Not empty.
    pub(super) levels: Vec<FileLevel>,
    /// The node of the level that tells the bounds: of those that are in the file, the most detailed one.
    pub(super) of_bounds: usize,
}

/// A level, as its node describes it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileLevel {
    pub(super) node: usize,
    pub(super) level: u32,
    pub(super) budget: u32,
    pub(super) faces: u32,
    /// A fraction of the diagonal of the source's bounding box.
    pub(super) error: f32,
}

#[derive(Deserialize)]
struct Extras {
    simpliguard: Stamp,
}

#[derive(Deserialize)]
struct Stamp {
    level: u32,
    budget: u32,
    faces: u32,
    error: f32,
    replaces: Vec<usize>,
    /// The node of the object. Only levels of objects have one.
    object: Option<usize>,
    space: Option<usize>,
    /// True for levels that stand for all objects.
    #[serde(default)]
    whole: bool,
}

impl LodFile {
    /// The levels of a document. `None` if it has none, or only levels of another tool. `is_away` tells for a mesh whether the
    /// file has a placeholder in its place.
    pub(super) fn read(document: &gltf::Document, name: &str, is_away: impl Fn(usize) -> bool) -> Option<Self> {
        let objects = objects(document, name);
        let mut groups: Vec<FileGroup> = match objects.is_empty() {
            true => whole(document, name).into_iter().collect(),
            false => objects.into_iter().chain(of_all_objects(document, name)).collect(),
        };
        if groups.is_empty() {
            return None;
        }
        let (mut by_mesh, mut mirrored) = (HashMap::<usize, Vec<usize>>::new(), HashSet::new());
        let rest = rest_pose(document);
        let mesh_of = |level: &FileLevel| document.nodes().nth(level.node)?.mesh();
        for (number, group) in groups.iter_mut().enumerate() {
            let is_there = |level: &&FileLevel| mesh_of(level).is_some_and(|mesh| !is_away(mesh.index()));
            if let Some(level) = group.levels.iter().find(is_there) {
                group.of_bounds = level.node;
            }
            if let Some(mesh) = document.nodes().nth(group.of_bounds).and_then(|node| node.mesh()) {
                by_mesh.entry(mesh.index()).or_default().push(number);
            }
            if group.is_mirrored(&rest) {
                let meshes = group.levels.iter().filter_map(mesh_of);
                mirrored.extend(meshes.flat_map(|mesh| mesh.primitives()).filter_map(|p| p.material().index()));
            }
        }
        Some(Self { document: document.clone(), rest, names: names(document), groups, by_mesh, mirrored })
    }

    /// The path of a node: its name and those of all nodes above it.
    pub(super) fn path(&self, node: usize) -> String {
        let mut path: Vec<&str> = Vec::new();
        let mut next = Some(node);
        // The loader refuses nodes with two parents later. Here the walk only has to end.
        while let Some((parent, name)) = next.filter(|_| path.len() <= self.names.len()).map(|node| &self.names[node]) {
            path.push(name);
            next = *parent;
        }
        path.reverse();
        path.join("/")
    }

    pub(super) fn node(&self, index: usize) -> Option<gltf::Node<'_>> {
        self.document.nodes().nth(index)
    }

    /// The transform from the space of a group's levels to the scene, in the rest pose.
    pub(super) fn space_of(&self, group: &FileGroup) -> Mat4 {
        group.space(&self.rest)
    }
}

impl FileGroup {
    fn new(holder: usize, stamps: Vec<(usize, Stamp)>) -> Option<Self> {
        let (_, first) = stamps.first()?;
        let of = match first {
            Stamp { object: Some(_), .. } => Of::Object,
            Stamp { whole: true, .. } => Of::AllObjects,
            _ => Of::Scene,
        };
        let (space, replaces) = (first.space, first.replaces.clone());
        let mut levels: Vec<FileLevel> = stamps.into_iter().map(|(node, s)| FileLevel::new(node, &s)).collect();
        levels.sort_by_key(|level| std::cmp::Reverse(level.budget));
        let of_bounds = levels.first()?.node;
        Some(Self { holder, of, space, replaces, levels, of_bounds })
    }

    /// The nodes that a scene must have.
    pub(super) fn nodes(&self) -> impl Iterator<Item = &usize> {
        std::iter::once(&self.holder).chain(&self.space).chain(&self.replaces)
    }

    /// True if triangles turn their backs in the space of the levels.
    pub(super) fn is_mirrored(&self, rest: &[Mat4]) -> bool {
        self.space(rest).determinant() < 0.0
    }

    fn space(&self, rest: &[Mat4]) -> Mat4 {
        self.space.and_then(|space| rest.get(space).copied()).unwrap_or(Mat4::IDENTITY)
    }
}

/// The levels of each object, in the order of their nodes.
fn objects(document: &gltf::Document, name: &str) -> Vec<FileGroup> {
    let mut by_object: BTreeMap<usize, Vec<(usize, Stamp)>> = BTreeMap::new();
    for (stamp, node) in document.nodes().filter_map(|node| Some((stamp(&node)?, node))) {
        if let Some(object) = stamp.object.filter(|_| is_usable(&node, &stamp, name)) {
            by_object.entry(object).or_default().push((node.index(), stamp));
        }
    }
    by_object.into_iter().filter_map(|(object, stamps)| FileGroup::new(object, stamps)).collect()
}

/// The levels that stand for all objects.
fn of_all_objects(document: &gltf::Document, name: &str) -> Option<FileGroup> {
    let stamps = document.nodes().filter_map(|node| {
        let stamp = stamp(&node).filter(|stamp| stamp.whole && is_usable(&node, stamp, name))?;
        Some((node.index(), stamp))
    });
    let stamps: Vec<(usize, Stamp)> = stamps.collect();
    let holder = *stamps.first()?.1.replaces.first()?;
    FileGroup::new(holder, stamps)
}

/// The levels of a scene without objects.
fn whole(document: &gltf::Document, name: &str) -> Option<FileGroup> {
    document.nodes().find_map(|holder| {
        let ids = level_nodes(holder.extension_value("MSFT_lod")?);
        let stamp = |id: usize| {
            let node = document.nodes().nth(id)?;
            Some((id, stamp(&node).filter(|stamp| is_usable(&node, stamp, name))?))
        };
        let group = FileGroup::new(holder.index(), ids.into_iter().filter_map(stamp).collect());
        if group.is_none() {
            debug!("{name}: MSFT_lod of node {} is not by simpliguard and left alone", holder.index());
        }
        group
    })
}

/// The parent of each node, and its name, which is different from those of its siblings.
fn names(document: &gltf::Document) -> Vec<(Option<usize>, String)> {
    let mut names: Vec<(Option<usize>, String)> = document.nodes().map(|_| (None, String::new())).collect();
    for (parent, child) in document.nodes().flat_map(|node| node.children().map(move |child| (node.index(), child))) {
        names[child.index()].0 = Some(parent);
    }
    let mut times: HashMap<(Option<usize>, String), usize> = HashMap::new();
    for node in document.nodes() {
        let (parent, unique) = &mut names[node.index()];
        let name = node.name().map_or_else(|| format!("node {}", node.index()), str::to_owned);
        let times = times.entry((*parent, name.clone())).or_default();
        *times += 1;
        *unique = if *times > 1 { format!("{name}#{times}") } else { name };
    }
    names
}

/// The transforms from the space of each node to the scene, in the rest pose.
fn rest_pose(document: &gltf::Document) -> Vec<Mat4> {
    let local: Vec<Mat4> = document.nodes().map(|n| Mat4::from_cols_array_2d(&n.transform().matrix())).collect();
    let mut is_child = vec![false; local.len()];
    for child in document.nodes().flat_map(|node| node.children()) {
        is_child[child.index()] = true;
    }
    let mut rest = local;
    let mut open: Vec<gltf::Node<'_>> = document.nodes().filter(|node| !is_child[node.index()]).collect();
    // The loader refuses nodes with two parents later. Here the walk only has to end.
    let mut is_done = vec![false; rest.len()];
    while let Some(node) = open.pop() {
        for child in node.children().filter(|child| !std::mem::replace(&mut is_done[child.index()], true)) {
            rest[child.index()] = rest[node.index()] * rest[child.index()];
            open.push(child);
        }
    }
    rest
}

impl FileLevel {
    fn new(node: usize, stamp: &Stamp) -> Self {
        Self { node, level: stamp.level, budget: stamp.budget, faces: stamp.faces, error: stamp.error }
    }
}

fn level_nodes(extension: &Value) -> Vec<usize> {
    let ids = extension.get("ids").and_then(Value::as_array);
    ids.into_iter().flatten().filter_map(|id| usize::try_from(id.as_u64()?).ok()).collect()
}

/// The stamp of a level node. `None` if the node is no level of this program.
fn stamp(node: &gltf::Node<'_>) -> Option<Stamp> {
    let extras = node.extras().as_ref()?;
    Some(deserialize::from_str::<Extras>(extras.get()).ok()?.simpliguard)
}

/// Tells whether a level can be used; if not, the log says so.
fn is_usable(node: &gltf::Node<'_>, stamp: &Stamp, name: &str) -> bool {
    let is_usable = stamp.level > 0 && stamp.error.is_finite() && stamp.error >= 0.0 && node.mesh().is_some();
    if !is_usable {
        warn!("{name}: node {} is a damaged level and is left out; bake the model again", node.index());
    }
    is_usable
}

/// Number of triangles that a primitive draws.
pub(super) fn faces(primitive: &gltf::Primitive<'_>) -> u32 {
    let positions = || primitive.get(&gltf::Semantic::Positions);
    let corners = primitive.indices().or_else(positions).map_or(0, |accessor| accessor.count());
    let faces = match primitive.mode() {
        Mode::Triangles => corners / 3,
        Mode::TriangleStrip | Mode::TriangleFan => corners.saturating_sub(2),
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => 0,
    };
    u32::try_from(faces).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn read(nodes: serde_json::Value) -> Option<LodFile> {
        let json = json!({
            "asset": { "version": "2.0" },
            "accessors": [
                { "componentType": 5126, "type": "VEC3", "count": 9, "min": [0, 0, 0], "max": [1, 1, 1] },
                { "componentType": 5123, "type": "SCALAR", "count": 6 },
            ],
            "meshes": [{ "primitives": [
                { "attributes": { "POSITION": 0 } },
                { "attributes": { "POSITION": 0 }, "indices": 1 },
                { "attributes": { "POSITION": 0 }, "indices": 1, "mode": 5 },
                { "attributes": { "POSITION": 0 }, "mode": 1 },
            ] }],
            "nodes": nodes,
        });
        let document = gltf::Gltf::from_slice_without_validation(json.to_string().as_bytes()).expect("glTF").document;
        LodFile::read(&document, "model.glb", |_| false)
    }

    fn holder(ids: serde_json::Value) -> serde_json::Value {
        json!({ "mesh": 0, "extensions": { "MSFT_lod": { "ids": ids } } })
    }

    fn level(level: u32, budget: u32, error: f32) -> serde_json::Value {
        let stamp = json!({
            "version": "1", "level": level, "budget": budget, "faces": budget - 1, "error": error, "replaces": [0, 3],
        });
        json!({ "mesh": 0, "extras": { "simpliguard": stamp } })
    }

    #[test]
    fn levels_come_in_falling_detail_with_what_they_replace() {
        let file = read(json!([holder(json!([1, 2])), level(1, 10, 0.5), level(2, 20, 0.25)])).expect("levels");
        let [group] = &file.groups[..] else { panic!("one group") };
        assert_eq!((group.holder, group.of, &group.replaces[..]), (0, Of::Scene, &[0, 3][..]));
        let expected = |node, level, budget, error| FileLevel { node, level, budget, faces: budget - 1, error };
        assert_eq!(group.levels, [expected(2, 2, 20, 0.25), expected(1, 1, 10, 0.5)]);
    }

    #[test]
    fn each_object_has_its_levels() {
        let of = |object: usize, number, error| {
            let mut node = level(number, 10 * number, error);
            node["extras"]["simpliguard"]["object"] = json!(object);
            node["extras"]["simpliguard"]["space"] = json!(object);
            node
        };
        let mirrored = json!({ "mesh": 0, "scale": [1, -1, 1], "children": [2] });
        let moved = json!({ "mesh": 0, "translation": [3, 0, 0] });
        let mut whole = level(1, 10, 0.5);
        whole["extras"]["simpliguard"]["whole"] = json!(true);
        let nodes = json!([{}, mirrored, moved, of(2, 1, 0.5), of(1, 1, 0.5), of(2, 2, 0.25), whole]);
        let file = read(nodes).expect("levels");
        let groups: Vec<_> =
            file.groups.iter().map(|g| (g.holder, g.of, g.levels.len(), g.is_mirrored(&file.rest))).collect();
        let expected = [(1, Of::Object, 1, true), (2, Of::Object, 2, true), (0, Of::AllObjects, 1, false)];
        assert_eq!(groups, expected);
        assert_eq!(file.groups[1].levels[0].node, 5, "the most detailed comes first");
        assert_eq!(file.by_mesh[&0], [0, 1, 2]);
        assert_eq!(file.rest[2].transform_point3(bevy::math::Vec3::Y), bevy::math::vec3(3.0, -1.0, 0.0));
    }

    #[test]
    fn nodes_have_paths_by_which_they_are_known_again() {
        let mut nodes = vec![json!({ "name": "House", "children": [1, 2, 3] })];
        nodes.extend([json!({ "name": "Door" }), json!({ "name": "Door" }), json!({})]);
        let mut object = level(1, 10, 0.5);
        object["extras"]["simpliguard"]["object"] = json!(1);
        nodes.push(object);
        let file = read(json!(nodes)).expect("levels");
        assert_eq!([0, 1, 2, 3].map(|node| file.path(node)), ["House", "House/Door", "House/Door#2", "House/node 3"]);
    }

    #[test]
    fn levels_of_another_tool_are_left_alone() {
        assert!(read(json!([holder(json!([1])), { "mesh": 0 }])).is_none());
        assert!(read(json!([holder(json!([1])), { "mesh": 0, "extras": { "simpliguard": 1 } }])).is_none());
        assert!(read(json!([{ "mesh": 0 }])).is_none());
    }

    #[test]
    fn a_level_that_cannot_be_used_is_left_out() {
        let broken = |key: &str, value: serde_json::Value| {
            let mut node = level(1, 10, 0.5);
            node["extras"]["simpliguard"][key] = value;
            node
        };
        let without_mesh = json!({ "extras": level(1, 10, 0.5)["extras"] });
        for node in [broken("error", json!(-0.1)), broken("level", json!(0)), without_mesh] {
            assert!(read(json!([holder(json!([1, 7])), node])).is_none());
        }
    }

    #[test]
    fn faces_are_counted_for_each_mode() {
        let file = read(json!([holder(json!([1])), level(1, 10, 0.5)])).expect("levels");
        let mesh = file.document.meshes().next().expect("a mesh");
        assert_eq!(mesh.primitives().map(|p| faces(&p)).collect::<Vec<_>>(), [3, 2, 4, 0]);
    }
}
