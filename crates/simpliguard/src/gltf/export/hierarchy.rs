//! Node trees: roots of scenes, copies for the scenes of single levels, and levels that a file came with.

use serde_json::{Value, json};

use super::builder::{Builder, Kind, indices};
use super::clips;

/// Transform properties of a node.
pub(in crate::gltf) const TRANSFORM: [&str; 4] = ["matrix", "translation", "rotation", "scale"];

/// The root nodes of a scene.
pub(in crate::gltf) fn scene_roots(out: &Builder, scene: usize) -> Vec<usize> {
    let nodes = out.all(Kind::Node).len();
    out.all(Kind::Scene).get(scene).map_or_else(Vec::new, |s| indices(s, "nodes").filter(|&n| n < nodes).collect())
}

/// `roots` and all nodes under them, parents before children, each once.
pub(in crate::gltf) fn descendants(out: &Builder, roots: &[usize]) -> Vec<usize> {
    let nodes = out.all(Kind::Node);
    let mut seen = vec![false; nodes.len()];
    let mut stack: Vec<usize> = roots.iter().rev().copied().collect();
    let mut order = Vec::new();
    while let Some(node) = stack.pop() {
        if node >= nodes.len() || std::mem::replace(&mut seen[node], true) {
            continue;
        }
        order.push(node);
        let children: Vec<usize> = indices(&nodes[node], "children").collect();
        stack.extend(children.into_iter().rev());
    }
    order
}

/// Marks the nodes of `order` (parents first) that stay once meshes, cameras and extensions are removed: nodes that are
/// `needed`, their ancestors, and nodes that never had any of these, such as attachment points. Leaves that exist only
/// to hold a mesh, camera or light are not marked.
pub(in crate::gltf) fn kept_nodes(out: &Builder, order: &[usize], needed: impl Fn(usize) -> bool) -> Vec<bool> {
    let nodes = out.all(Kind::Node);
    let mut kept = vec![false; nodes.len()];
    for &node in order.iter().rev() {
        let has_content = ["mesh", "camera", "extensions"].iter().any(|key| nodes[node].get(key).is_some());
        kept[node] = needed(node)
            || !has_content
            || indices(&nodes[node], "children").any(|c| kept.get(c).copied().unwrap_or(false));
    }
    kept
}

/// Copies the trees under `roots`, with names and transforms only. `suffix` is added to the names, so that they differ
/// from the source's. Returns the copied roots, and the copy of each node.
pub(in crate::gltf) fn copy_trees(
    out: &mut Builder,
    roots: &[usize],
    suffix: &str,
    is_joint: impl Fn(usize) -> bool,
) -> (Vec<usize>, Vec<Option<usize>>) {
    let order = descendants(out, roots);
    let kept = kept_nodes(out, &order, is_joint);
    let first = out.all(Kind::Node).len();
    let mut copy_of = vec![None; first];
    for (i, &node) in order.iter().filter(|&&n| kept[n]).enumerate() {
        copy_of[node] = Some(first + i);
    }
    for &node in order.iter().filter(|&&n| kept[n]) {
        let source = &out.all(Kind::Node)[node];
        let mut copy = json!({});
        if let Some(name) = source.get("name").and_then(Value::as_str) {
            copy["name"] = json!(format!("{name}{suffix}"));
        }
        for key in TRANSFORM {
            if let Some(value) = source.get(key) {
                copy[key] = value.clone();
            }
        }
        let children: Vec<usize> =
            indices(source, "children").filter_map(|c| copy_of.get(c).copied().flatten()).collect();
        if !children.is_empty() {
            copy["children"] = json!(children);
        }
        out.push(Kind::Node, copy);
    }
    (roots.iter().filter_map(|&r| copy_of.get(r).copied().flatten()).collect(), copy_of)
}

/// `roots`, and the roots above those of `nodes` that are not under `roots`.
pub(in crate::gltf) fn with_roots_of(out: &Builder, mut roots: Vec<usize>, nodes: &[usize]) -> Vec<usize> {
    let all = out.all(Kind::Node);
    let mut parent = vec![None; all.len()];
    for (p, node) in all.iter().enumerate() {
        for child in indices(node, "children").filter(|&c| c < all.len()) {
            parent[child] = Some(p);
        }
    }
    for &node in nodes.iter().filter(|&&n| n < all.len()) {
        let mut root = node;
        // At most as many steps as there are nodes, in case the parents form a cycle.
        for _ in 0..all.len() {
            let Some(above) = parent[root] else { break };
            root = above;
        }
        if !roots.contains(&root) {
            roots.push(root);
        }
    }
    roots
}

/// True if one of `roots` has all of `joints` under it, as glTF requires of a skin.
pub(in crate::gltf) fn have_common_root(out: &Builder, roots: &[usize], joints: &[usize]) -> bool {
    roots.iter().any(|&root| {
        let mut under = vec![false; out.all(Kind::Node).len()];
        descendants(out, &[root]).into_iter().for_each(|n| under[n] = true);
        joints.iter().all(|&j| under.get(j).copied().unwrap_or(false))
    })
}

/// Puts the roots of a scene under one new node, for a skin whose joints lie under several roots. Other scenes that
/// hold all these roots get the new node too. If a scene holds only some of them, nothing changes, since a scene's
/// nodes must be roots.
pub(in crate::gltf) fn join_roots(out: &mut Builder, scene: usize) {
    let roots = scene_roots(out, scene);
    let holds = |s: &Value| roots.iter().filter(|&&r| indices(s, "nodes").any(|n| n == r)).count();
    if roots.is_empty() || out.all(Kind::Scene).iter().any(|s| !matches!(holds(s), n if n == 0 || n == roots.len())) {
        return;
    }
    let joined = out.push(Kind::Node, json!({ "name": "root", "children": roots }));
    for scene in out.all_mut(Kind::Scene) {
        let mut nodes: Vec<usize> = indices(scene, "nodes").collect();
        let Some(at) = nodes.iter().position(|n| roots.contains(n)) else { continue };
        nodes[at] = joined;
        nodes.retain(|n| !roots.contains(n));
        scene["nodes"] = json!(nodes);
    }
}

/// Takes the levels that a file came with out of its scenes: `levels` are their nodes, with those below them. Their meshes
/// keep their indices. `finest` stays in place of lost channels.
pub(in crate::gltf) fn remove_levels(out: &mut Builder, levels: &[usize], finest: Option<usize>) {
    let Some(finest) = finest.filter(|_| !levels.is_empty()) else { return };
    remove_meshes(out, levels);
    clips::drop_lost_channels(out, |node| !levels.contains(&node), finest);
}

/// Removes mesh, skin and morph weights from nodes.
pub(in crate::gltf) fn remove_meshes(out: &mut Builder, nodes: &[usize]) {
    let all = out.all_mut(Kind::Node);
    for &node in nodes {
        if let Some(node) = all.get_mut(node).and_then(Value::as_object_mut) {
            for key in ["mesh", "skin", "weights"] {
                node.remove(key);
            }
        }
    }
}
