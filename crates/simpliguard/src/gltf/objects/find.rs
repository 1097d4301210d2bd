//! The objects of the default scene.

use std::collections::{BTreeMap, BTreeSet};

use globset::GlobMatcher;
use serde_json::Value;

use crate::gltf::export::builder::{Builder, Kind, index, indices};
use crate::gltf::export::hierarchy::{descendants, scene_roots};

/// An object of the scene.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Object {
    /// The node whose levels they are.
    pub(super) holder: usize,
    /// The node in whose space the object is described; `None` for the space of the scene. Its own transform is not part
    /// of the object.
    pub(super) anchor: Option<usize>,
    /// The object's nodes, parents before children: mesh nodes, joints, and what lies between them and the anchor.
    pub(super) nodes: Vec<usize>,
    /// The mesh nodes, ascending.
    pub(super) mesh_nodes: Vec<usize>,
    /// True if nothing else that can be seen lies under the anchor.
    pub(super) owns_subtree: bool,
}

/// Divides `mesh_nodes` into objects, in the order of their first nodes. The name of the topmost node of a group matches
/// one of `patterns`.
pub(super) fn find(out: &Builder, mesh_nodes: &[usize], patterns: &[GlobMatcher]) -> Vec<Object> {
    let tree = Tree::of(out);
    let mut sets = Sets::new(out.all(Kind::Node).len());
    let joints = tree.unite_skins(out, mesh_nodes, &mut sets);
    let groups = tree.unite_groups(out, mesh_nodes, patterns, &mut sets);
    let mut by_set = |nodes: &[usize]| {
        let mut out: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        nodes.iter().for_each(|&node| out.entry(sets.root(node)).or_default().push(node));
        out
    };
    let (members, mut joints, groups) = (by_set(mesh_nodes), by_set(&joints), by_set(&groups));
    let object = |(set, mesh_nodes)| {
        let group = groups.get(&set).and_then(|groups| groups.first().copied());
        tree.object(out, (mesh_nodes, &joints.remove(&set).unwrap_or_default()), group)
    };
    let mut objects: Vec<Object> = members.into_iter().map(object).collect();
    objects.sort_by_key(|object| object.mesh_nodes[0]);
    objects
}

/// Disjoint sets of nodes.
struct Sets(Vec<usize>);

impl Sets {
    fn new(nodes: usize) -> Self {
        Self((0..nodes).collect())
    }

    /// The node that stands for the set of `node`. Shortens the way to it.
    fn root(&mut self, node: usize) -> usize {
        let mut root = node;
        while self.0[root] != root {
            root = self.0[root];
        }
        let mut at = node;
        while at != root {
            at = std::mem::replace(&mut self.0[at], root);
        }
        root
    }

    fn unite(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        // The smaller index stands for both, so that the result does not depend on the order.
        self.0[a.max(b)] = a.min(b);
    }
}

/// The node tree of the default scene.
struct Tree {
    roots: Vec<usize>,
    /// Parents before children.
    order: Vec<usize>,
    parent: Vec<Option<usize>>,
    depth: Vec<usize>,
}

impl Tree {
    fn of(out: &Builder) -> Self {
        let nodes = out.all(Kind::Node);
        let roots = scene_roots(out, out.default_scene());
        let order = descendants(out, &roots);
        let (mut parent, mut depth) = (vec![None; nodes.len()], vec![0; nodes.len()]);
        for &node in &order {
            for child in indices(&nodes[node], "children").filter(|&child| child < nodes.len()) {
                parent[child] = Some(node);
                depth[child] = depth[node] + 1;
            }
        }
        Self { roots, order, parent, depth }
    }

    /// Unites each skin with its joints, its mesh nodes and everything under its joints. Returns the joints in the scene,
    /// ascending.
    fn unite_skins(&self, out: &Builder, mesh_nodes: &[usize], sets: &mut Sets) -> Vec<usize> {
        let nodes = out.all(Kind::Node);
        let mut is_in_scene = vec![false; nodes.len()];
        self.order.iter().for_each(|&node| is_in_scene[node] = true);
        let mut is_joint = vec![false; nodes.len()];
        for &node in mesh_nodes {
            let skin = index(&nodes[node], "skin").and_then(|skin| out.all(Kind::Skin).get(skin));
            let joints = skin.into_iter().flat_map(|skin| indices(skin, "joints"));
            for joint in joints.filter(|&joint| joint < nodes.len() && is_in_scene[joint]) {
                is_joint[joint] = true;
                sets.unite(node, joint);
            }
        }
        let mut joint_above = vec![None; nodes.len()];
        for &node in &self.order {
            let above = self.parent[node].and_then(|parent| joint_above[parent]);
            if let Some(above) = above {
                sets.unite(node, above);
            }
            joint_above[node] = if is_joint[node] { Some(node) } else { above };
        }
        (0..nodes.len()).filter(|&node| is_joint[node]).collect()
    }

    /// Unites each topmost node that matches a pattern with the mesh nodes under it. Returns these nodes.
    fn unite_groups(
        &self,
        out: &Builder,
        mesh_nodes: &[usize],
        patterns: &[GlobMatcher],
        sets: &mut Sets,
    ) -> Vec<usize> {
        let nodes = out.all(Kind::Node);
        let mut group_of: Vec<Option<usize>> = vec![None; nodes.len()];
        if patterns.is_empty() {
            return Vec::new();
        }
        let matches = |node: usize| {
            let name = nodes[node].get("name").and_then(Value::as_str);
            name.is_some_and(|name| patterns.iter().any(|pattern| pattern.is_match(name)))
        };
        for &node in &self.order {
            let above = self.parent[node].and_then(|parent| group_of[parent]);
            group_of[node] = above.or_else(|| matches(node).then_some(node));
        }
        let mut groups = Vec::new();
        for (node, group) in mesh_nodes.iter().filter_map(|&node| Some((node, group_of[node]?))) {
            sets.unite(node, group);
            groups.push(group);
        }
        groups.dedup();
        groups
    }

    /// The object of some mesh nodes and joints.
    fn object(&self, out: &Builder, (mesh_nodes, joints): (Vec<usize>, &[usize]), group: Option<usize>) -> Object {
        let members = || mesh_nodes.iter().chain(joints).copied();
        let mut anchor = match group.filter(|&group| members().all(|node| self.is_under(node, group))) {
            Some(group) => Some(group),
            None => members().map(Some).reduce(|a, b| self.common_ancestor(a, b)).flatten(),
        };
        // The transform of a joint is part of the pose.
        while let Some(joint) = anchor.filter(|anchor| joints.contains(anchor)) {
            anchor = self.parent[joint];
        }
        let nodes = self.nodes_between(out, anchor, members());
        let owns_subtree = anchor.is_some_and(|anchor| {
            let below = descendants(out, &[anchor]);
            below.iter().all(|node| mesh_nodes.binary_search(node).is_ok() || !has_content(&out.all(Kind::Node)[*node]))
        });
        let is_single = mesh_nodes.len() == 1 && joints.is_empty();
        let holder = anchor.filter(|_| owns_subtree || is_single).unwrap_or(mesh_nodes[0]);
        Object { holder, anchor, nodes, mesh_nodes, owns_subtree }
    }

    fn is_under(&self, node: usize, ancestor: usize) -> bool {
        std::iter::successors(Some(node), |&node| self.parent[node]).any(|node| node == ancestor)
    }

    fn common_ancestor(&self, a: Option<usize>, b: Option<usize>) -> Option<usize> {
        let (mut a, mut b) = (a?, b?);
        while a != b {
            let deeper = if self.depth[a] >= self.depth[b] { &mut a } else { &mut b };
            *deeper = self.parent[*deeper]?;
        }
        Some(a)
    }

    /// The nodes on the ways from the anchor to each of `members`, ends included, parents before children.
    fn nodes_between(&self, out: &Builder, anchor: Option<usize>, members: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut needed = BTreeSet::new();
        for member in members {
            let mut way =
                std::iter::successors(Some(member), |&node| self.parent[node].filter(|_| Some(node) != anchor));
            // What is known leads to the anchor already.
            while way.next().is_some_and(|node| needed.insert(node)) {}
        }
        let start = |root: &&usize| needed.contains(*root);
        let mut open: Vec<usize> = match anchor {
            Some(anchor) => vec![anchor],
            None => self.roots.iter().filter(start).rev().copied().collect(),
        };
        let mut nodes = Vec::new();
        while let Some(node) = open.pop() {
            nodes.push(node);
            let children: Vec<usize> = indices(&out.all(Kind::Node)[node], "children").collect();
            open.extend(children.into_iter().rev().filter(|child| needed.contains(child)));
        }
        nodes
    }
}

/// True for a node that shows something, or that an extension gives a meaning.
fn has_content(node: &Value) -> bool {
    ["mesh", "camera", "extensions"].iter().any(|key| node.get(key).is_some())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::data::NodePattern;

    fn objects(nodes: Value, skins: Value, patterns: &[&str]) -> Vec<Object> {
        let mut out = Builder::new("test");
        let roots: Vec<usize> = {
            let nodes = nodes.as_array().expect("a list");
            let children: Vec<usize> = nodes.iter().flat_map(|node| indices(node, "children")).collect();
            (0..nodes.len()).filter(|node| !children.contains(node)).collect()
        };
        let mesh_nodes: Vec<usize> = {
            let nodes = nodes.as_array().expect("a list");
            (0..nodes.len()).filter(|&node| nodes[node].get("mesh").is_some()).collect()
        };
        out.json.insert("nodes".into(), nodes);
        out.json.insert("skins".into(), skins);
        out.json.insert("scenes".into(), json!([{ "nodes": roots }]));
        let patterns: Vec<_> = patterns.iter().filter_map(|p| NodePattern((*p).to_owned()).matcher()).collect();
        find(&out, &mesh_nodes, &patterns)
    }

    fn single(node: usize, owns_subtree: bool) -> Object {
        Object { holder: node, anchor: Some(node), nodes: vec![node], mesh_nodes: vec![node], owns_subtree }
    }

    #[test]
    fn each_mesh_node_is_an_object() {
        let nodes = json!([{ "mesh": 0, "children": [1, 2] }, { "mesh": 0 }, { "children": [3] }, { "mesh": 1 }]);
        assert_eq!(objects(nodes, json!([]), &[]), [single(0, false), single(1, true), single(3, true)]);
    }

    #[test]
    fn a_pattern_makes_one_object_of_a_tree() {
        let nodes = json!([
            { "name": "Lamp.1", "children": [1, 2] }, { "mesh": 0, "name": "Lamp.foot" }, { "children": [3] },
            { "mesh": 1 }, { "mesh": 2, "name": "House" }, { "name": "Lamp.2" },
        ]);
        let lamp =
            Object { holder: 0, anchor: Some(0), nodes: vec![0, 1, 2, 3], mesh_nodes: vec![1, 3], owns_subtree: true };
        assert_eq!(objects(nodes, json!([]), &["Lamp*"]), [lamp, single(4, true)]);
    }

    #[test]
    fn a_skin_and_all_that_hangs_on_it_is_one_object() {
        // An armature with a body, a joint, another joint with a sword; a stone beside the armature.
        let nodes = json!([
            { "children": [1, 5] }, { "children": [2, 3] }, { "mesh": 0, "skin": 0 }, { "children": [4] },
            { "children": [6] }, { "mesh": 1 }, { "mesh": 2 },
        ]);
        let hero = Object {
            holder: 1,
            anchor: Some(1),
            nodes: vec![1, 2, 3, 4, 6],
            mesh_nodes: vec![2, 6],
            owns_subtree: true,
        };
        assert_eq!(objects(nodes, json!([{ "joints": [3, 4] }]), &[]), [hero, single(5, true)]);
    }

    #[test]
    fn an_object_whose_nodes_share_their_parent_with_others_is_held_by_its_mesh() {
        let nodes = json!([{ "children": [1, 2, 3] }, { "mesh": 0, "skin": 0 }, {}, { "mesh": 1 }, { "mesh": 0, "skin": 1 }, {}]);
        let found = objects(nodes, json!([{ "joints": [2] }, { "joints": [5] }]), &[]);
        let below_root =
            Object { holder: 1, anchor: Some(0), nodes: vec![0, 1, 2], mesh_nodes: vec![1], owns_subtree: false };
        let in_the_scene =
            Object { holder: 4, anchor: None, nodes: vec![4, 5], mesh_nodes: vec![4], owns_subtree: false };
        assert_eq!(found, [below_root, single(3, true), in_the_scene]);
    }
}
