//! One level as a file of its own.

use serde_json::json;

use super::builder::{Builder, Kind, indices};
use super::level::{EncodedLevel, level_node};
use super::params::CRATE_VERSION;
use super::skin::Binding;
use super::textures::push_sampler;
use super::{clips, embed, hierarchy, lods, prune};
use crate::data::{Level, Model};
use crate::{Cancellation, Error};

/// One level as a file of its own: the default scene holds the level with its material and textures, and for a model
/// with clips or bones the source's nodes, skin and every clip in order. Channels of morph weights are the level's own.
///
/// # Errors
/// As [`export`](super::export).
pub fn export_level(model: &Model, level: &Level) -> Result<Vec<u8>, Error> {
    let shared = Binding::new(model, std::slice::from_ref(level))?;
    let skin = shared.map(|shared| shared.narrowed(level).unwrap_or(shared));
    let encoded = EncodedLevel::new(model, level, skin.as_ref(), &Cancellation::default())?;
    let mut out = embed::embed(&model.name, &model.document)?;
    out.stamp(CRATE_VERSION);
    lods::remove_lods(&mut out);
    keep_default_scene(&mut out, skin.as_ref());
    let skin = skin.as_ref().map(|skin| skin.write(&mut out));
    let sampler = push_sampler(&mut out);
    let mesh = encoded.write(&mut out, "LOD", sampler);
    let node = out.push(Kind::Node, level_node("LOD", mesh, skin));
    let mut nodes: Vec<usize> = hierarchy::scene_roots(&out, 0);
    nodes.push(node);
    out.all_mut(Kind::Scene)[0]["nodes"] = json!(nodes);
    if let Some(morphs) = model.surface.morphs.as_ref().filter(|_| encoded.has_morphs()) {
        clips::copy_weight_channels(&mut out, morphs.node, &[node]);
    }
    clips::drop_lost_channels(&mut out, |target| target == node, node);
    prune::prune(&mut out, &[Kind::Scene, Kind::Animation]);
    out.into_glb()
}

/// Leaves only the default scene, as scene 0. It keeps its nodes if bones or clips need them.
fn keep_default_scene(out: &mut Builder, skin: Option<&Binding>) {
    let roots = hierarchy::scene_roots(out, out.default_scene());
    let name = out.all(Kind::Scene).get(out.default_scene()).and_then(|s| s.get("name")?.as_str());
    let mut scene = json!({ "nodes": roots });
    if let Some(name) = name {
        scene["name"] = json!(name);
    }
    *out.all_mut(Kind::Scene) = vec![scene];
    out.json.insert("scene".into(), json!(0));
    if skin.is_none() && !clips::has_clips(out) {
        out.all_mut(Kind::Scene)[0]["nodes"] = json!([]);
        return;
    }
    let joints: Vec<usize> = skin.into_iter().flat_map(Binding::nodes).collect();
    strip_nodes(out, &roots, &joints);
    if let Some(skin) = skin {
        skin.join_roots(out, 0);
    }
}

/// Removes everything but names and transforms from the nodes, and the leaves that existed only for their content.
fn strip_nodes(out: &mut Builder, roots: &[usize], joints: &[usize]) {
    let order = hierarchy::descendants(out, roots);
    let mut needed = vec![false; out.all(Kind::Node).len()];
    for node in clips::moved_nodes(out).into_iter().chain(joints.iter().copied()) {
        if let Some(node) = needed.get_mut(node) {
            *node = true;
        }
    }
    let kept = hierarchy::kept_nodes(out, &order, |node| needed[node]);
    for node in out.all_mut(Kind::Node) {
        let children: Vec<usize> = indices(node, "children").filter(|&c| kept[c]).collect();
        let Some(node) = node.as_object_mut() else { continue };
        node.retain(|key, _| !["mesh", "skin", "weights", "camera", "extensions", "children"].contains(&key.as_str()));
        if !children.is_empty() {
            node.insert("children".into(), json!(children));
        }
    }
    let roots: Vec<usize> = roots.iter().copied().filter(|&r| kept[r]).collect();
    out.all_mut(Kind::Scene)[0]["nodes"] = json!(roots);
}
