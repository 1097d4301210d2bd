//! Levels out: binary glTF with the source in front, or one level alone.
//!
//! # Layout of a combined file
//! The source's scenes, nodes, meshes, skins and animations come first and keep their indices; its buffers and images
//! are embedded. Each level is one mesh and one node for the whole default scene. `MSFT_lod` stands once, on the only
//! root of the default scene, else on its first root with a mesh under it, with the level nodes in falling detail.
//! Level nodes are roots of their own, in no source scene, with `extras.simpliguard`. Scene `LOD<k>` (after the
//! source's scenes, `LOD1` having the smallest budget) shows one level alone.
//!
//! # Where a level stands
//! Static levels have world-space vertices and no transform: a loader shows the level node in place of the nodes in
//! `replaces` without a parent, whatever transform the node under `MSFT_lod` has. Skinned levels follow their joints,
//! as glTF ignores the transform of a skinned node.
//!
//! A level node of a skinned model hangs on the source's own joints. They are not in scene `LOD<k>`, and glTF wants
//! the joints of a skinned node in its scene: that scene has a copy of the node tree and a second node with the same
//! mesh on the copied joints, sharing the inverse bind matrices.

#[cfg(test)]
mod asset_tests;
mod builder;
mod clips;
mod embed;
mod hierarchy;
mod level;
mod prune;
mod ranges;
mod skin;
#[cfg(test)]
mod tests;
mod vertex_order;

use rayon::prelude::*;
use serde_json::{Value, json};

use self::builder::{Builder, Kind, indices, number};
use self::level::EncodedLevel;
use self::skin::Binding;
use crate::data::{Level, Model};
use crate::settings::SourceGeometry;
use crate::{Context, Error, StageId};

/// How levels are written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportOptions {
    /// What of the source goes along.
    pub source: SourceGeometry,
    /// Version of the chain, for `asset.generator` and `extras.simpliguard.version`.
    pub version: String,
}

impl Default for ExportOptions {
    fn default() -> Self {
        Self { source: SourceGeometry::Keep, version: env!("CARGO_PKG_VERSION").to_owned() }
    }
}

/// The source with `levels`, ascending by budget, as one binary glTF.
///
/// # Errors
/// [`Error::Invalid`] for a level whose arrays do not fit together, or that hangs on more than 256 joints of several
/// skins; [`Error::Limit`] above 4 GiB.
pub fn export(model: &Model, levels: &[Level], options: &ExportOptions) -> Result<Vec<u8>, Error> {
    export_in(model, levels, options, &Context::default())
}

/// As [`export`], within a bake that may be cancelled.
pub(crate) fn export_in(
    model: &Model,
    levels: &[Level],
    options: &ExportOptions,
    context: &Context<'_>,
) -> Result<Vec<u8>, Error> {
    let binding = Binding::new(model, levels)?;
    let narrowed: Vec<Option<Binding>> =
        levels.iter().map(|level| binding.as_ref().and_then(|b| b.narrowed(level))).collect();
    let encoded = encode(model, levels, binding.as_ref(), &narrowed, context)?;
    let mut out = embed::embed(model)?;
    stamp(&mut out, &options.version);
    let old_levels = hierarchy::remove_lods(&mut out);
    let joints: Vec<usize> = binding.iter().flat_map(Binding::nodes).collect();
    let scene = out.default_scene();
    join_roots_of(&mut out, scene, binding.as_ref());
    let roots = hierarchy::with_roots_of(&out, hierarchy::scene_roots(&out, scene), &joints);
    let shared = binding.as_ref().filter(|_| narrowed.iter().any(Option::is_none)).map(|b| b.write(&mut out));
    let skins: Vec<Option<usize>> =
        narrowed.iter().map(|own| own.as_ref().map(|b| b.write(&mut out)).or(shared)).collect();
    let writer = Writer { sampler: if levels.is_empty() { 0 } else { level::push_sampler(&mut out) }, roots, joints };
    let mut ids = Vec::new();
    let mut morphing = Vec::new();
    for (k, ((level, encoded), skin)) in levels.iter().zip(&encoded).zip(skins).enumerate() {
        let mut extras = json!({ "simpliguard": {
            "version": options.version,
            "level": k + 1,
            "budget": level.budget,
            "faces": level.mesh.triangles.len(),
            "error": number(level.error),
            "replaces": model.document.mesh_nodes,
        }});
        if let Some(morphs) = model.surface.morphs.as_ref().filter(|_| encoded.morphs()) {
            extras["simpliguard"]["morphs"] = json!(morphs.node);
        }
        let first = out.all(Kind::Node).len();
        ids.push(writer.write(&mut out, encoded, k + 1, skin, extras));
        if encoded.morphs() {
            let nodes = first..out.all(Kind::Node).len();
            morphing.extend(nodes.filter(|&node| out.all(Kind::Node)[node].get("mesh").is_some()));
        }
    }
    if let Some(morphs) = &model.surface.morphs {
        clips::weight_alike(&mut out, morphs.node, &morphing);
    }
    if !ids.is_empty() {
        ids.reverse();
        hierarchy::place_lods(&mut out, &model.document.mesh_nodes, &ids);
    }
    if let (SourceGeometry::Drop, Some(&still)) = (options.source, ids.first()) {
        let mut dropped = hierarchy::descendants(&out, &old_levels);
        dropped.extend(&model.document.mesh_nodes);
        hierarchy::remove_meshes(&mut out, &dropped);
        clips::drop_lost_channels(&mut out, |node| !dropped.contains(&node), still);
        prune::prune(&mut out, &[Kind::Scene, Kind::Node, Kind::Animation]);
    }
    out.into_glb()
}

/// One level as a file of its own: the default scene holds the level with its material and textures, and for a model
/// with clips or bones the source's nodes, skin and every clip in order. Channels of morph weights are the level's own.
///
/// # Errors
/// As [`export`].
pub fn export_level(model: &Model, level: &Level) -> Result<Vec<u8>, Error> {
    let binding = Binding::new(model, std::slice::from_ref(level))?;
    let binding = binding.map(|b| b.narrowed(level).unwrap_or(b));
    let encoded = EncodedLevel::new(model, level, binding.as_ref(), &Context::default())?;
    let mut out = embed::embed(model)?;
    stamp(&mut out, &ExportOptions::default().version);
    hierarchy::remove_lods(&mut out);
    let roots = hierarchy::scene_roots(&out, out.default_scene());
    let joints: Vec<usize> = binding.iter().flat_map(Binding::nodes).collect();
    keep_default_scene(&mut out, &roots);
    if binding.is_some() || clips::any(&out) {
        bare_nodes(&mut out, &roots, &joints);
        join_roots_of(&mut out, 0, binding.as_ref());
    } else {
        out.all_mut(Kind::Scene)[0]["nodes"] = json!([]);
    }
    let skin = binding.as_ref().map(|b| b.write(&mut out));
    let sampler = level::push_sampler(&mut out);
    let mesh = encoded.write(&mut out, "LOD", sampler);
    let node = out.push(Kind::Node, level_node("LOD", mesh, skin));
    let mut nodes: Vec<usize> = hierarchy::scene_roots(&out, 0);
    nodes.push(node);
    out.all_mut(Kind::Scene)[0]["nodes"] = json!(nodes);
    if let Some(morphs) = model.surface.morphs.as_ref().filter(|_| encoded.morphs()) {
        clips::weight_alike(&mut out, morphs.node, &[node]);
    }
    clips::drop_lost_channels(&mut out, |target| target == node, node);
    prune::prune(&mut out, &[Kind::Scene, Kind::Animation]);
    out.into_glb()
}

/// Gives the joints of a merged skin the common root that glTF asks for. A skin of the source has its own.
fn join_roots_of(out: &mut Builder, scene: usize, binding: Option<&Binding>) {
    let Some(binding) = binding.filter(|b| b.is_merged()) else { return };
    let joints: Vec<usize> = binding.nodes().collect();
    if !hierarchy::have_common_root(out, &hierarchy::scene_roots(out, scene), &joints) {
        hierarchy::join_roots(out, scene);
    }
}

/// Leaves only the default scene.
fn keep_default_scene(out: &mut Builder, roots: &[usize]) {
    let name = out.all(Kind::Scene).get(out.default_scene()).and_then(|s| s.get("name")?.as_str());
    let mut scene = json!({ "nodes": roots });
    if let Some(name) = name {
        scene["name"] = json!(name);
    }
    *out.all_mut(Kind::Scene) = vec![scene];
    out.json.insert("scene".into(), json!(0));
}

/// Takes from the nodes all they carry, and leaves out the leaves that were made to carry it.
fn bare_nodes(out: &mut Builder, roots: &[usize], joints: &[usize]) {
    let order = hierarchy::descendants(out, roots);
    let mut needed = vec![false; out.all(Kind::Node).len()];
    for node in clips::moved_nodes(out).into_iter().chain(joints.iter().copied()) {
        if let Some(node) = needed.get_mut(node) {
            *node = true;
        }
    }
    let kept = hierarchy::without_bare_leaves(out, &order, |node| needed[node]);
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

/// Appends levels to a document that has the source in front.
struct Writer {
    sampler: usize,
    /// Roots of the default scene, and those over joints outside of it.
    roots: Vec<usize>,
    joints: Vec<usize>,
}

impl Writer {
    /// Appends a level and its scene; returns its node. `skin` is on the source's joints.
    fn write(&self, out: &mut Builder, level: &EncodedLevel, k: usize, skin: Option<usize>, extras: Value) -> usize {
        let name = format!("LOD{k}");
        let mesh = level.write(out, &name, self.sampler);
        let skin = skin.filter(|_| level.is_skinned());
        let mut node = level_node(&name, mesh, skin);
        node["extras"] = extras;
        let node = out.push(Kind::Node, node);
        let scene = match skin {
            Some(skin) => self.scene_nodes(out, &name, mesh, skin),
            None => vec![node],
        };
        out.push(Kind::Scene, json!({ "name": name, "nodes": scene }));
        node
    }

    /// The nodes of a skinned level's scene: copies of the source's roots, and the level on the copied joints.
    fn scene_nodes(&self, out: &mut Builder, name: &str, mesh: usize, skin: usize) -> Vec<usize> {
        let is_joint = |node: usize| self.joints.contains(&node);
        let (mut nodes, copy_of) = hierarchy::copy_trees(out, &self.roots, &format!(" {name}"), is_joint);
        let source = &out.all(Kind::Skin)[skin];
        let joints: Vec<usize> = indices(source, "joints").filter_map(|n| copy_of.get(n).copied().flatten()).collect();
        let mut copy = json!({ "joints": &joints });
        if let Some(matrices) = source.get("inverseBindMatrices") {
            copy["inverseBindMatrices"] = matrices.clone();
        }
        let skin = out.push(Kind::Skin, copy);
        if !hierarchy::have_common_root(out, &nodes, &joints) {
            nodes = vec![out.push(Kind::Node, json!({ "name": format!("root {name}"), "children": nodes }))];
        }
        nodes.push(out.push(Kind::Node, level_node(&format!("{name} alone"), mesh, Some(skin))));
        nodes
    }
}

fn level_node(name: &str, mesh: usize, skin: Option<usize>) -> Value {
    let mut node = json!({ "name": name, "mesh": mesh });
    if let Some(skin) = skin {
        node["skin"] = json!(skin);
    }
    node
}

fn encode(
    model: &Model,
    levels: &[Level],
    binding: Option<&Binding>,
    narrowed: &[Option<Binding>],
    context: &Context<'_>,
) -> Result<Vec<EncodedLevel>, Error> {
    let own = levels.par_iter().zip(narrowed).map(|(level, own)| (level, own.as_ref().or(binding)));
    own.map(|(level, binding)| EncodedLevel::new(model, level, binding, context)).collect()
}

/// Names the writer in `asset`; copyright and the rest stay.
fn stamp(out: &mut Builder, version: &str) {
    let asset = out.json.entry("asset").or_insert_with(|| json!({ "version": "2.0" }));
    if let Some(asset) = asset.as_object_mut() {
        asset.insert("generator".into(), json!(format!("simpliguard {version}")));
    }
}

/// An error that points at the chain itself.
fn fault(asset: &str, found: impl Into<String>) -> Error {
    Error::invalid(asset, StageId::Export, found, "this is a fault of simpliguard: please report it with the model")
}
