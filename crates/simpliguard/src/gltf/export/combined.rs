//! The combined file: the source in front, the levels behind it.

use std::ops::Range;

use rayon::prelude::*;
use serde_json::{Value, json};

use super::builder::{Builder, Kind, indices, number};
use super::level::{EncodedLevel, level_node};
use super::params::ExportParams;
use super::skin::Binding;
use super::textures::push_sampler;
use super::{clips, embed, hierarchy, lods, prune};
use crate::data::{LayerMaterial, Level, LevelLayer, Model};
use crate::gltf::authored::level_nodes;
use crate::{Cancellation, Error};

/// As [`export`](super::export), within a bake that may be cancelled. `version` is written to `asset.generator` and to
/// `extras.simpliguard.version`.
pub(crate) fn export_in(
    model: &Model,
    levels: &[Level],
    params: &ExportParams,
    version: &str,
    cancellation: &Cancellation,
) -> Result<Vec<u8>, Error> {
    let skins = Skins::new(model, levels)?;
    let encoded = encode(model, levels, &skins, cancellation)?;
    let mut out = embed::embed(&model.name, &model.document)?;
    out.stamp(version);
    let mut old_levels = Vec::new();
    if !levels.is_empty() {
        old_levels.extend(level_nodes(out.all(Kind::Node)));
        old_levels.extend(lods::remove_lods(&mut out));
    }
    let writer = Writer::new(&mut out, &skins, levels.len());
    let mut nodes = Vec::new();
    let mut morphing = Vec::new();
    for (k, (level, encoded)) in levels.iter().zip(&encoded).enumerate() {
        let added = writer.write(&mut out, k, encoded, extras(model, version, k, level, encoded));
        nodes.push(added.start);
        if encoded.has_morphs() {
            morphing.extend(added.filter(|&node| out.all(Kind::Node)[node].get("mesh").is_some()));
        }
    }
    if let Some(morphs) = &model.surface.morphs {
        clips::copy_weight_channels(&mut out, morphs.node, &morphing);
    }
    if !nodes.is_empty() {
        nodes.reverse();
        let coverages = lods::screen_coverages(levels.iter().rev().map(|level| f64::from(level.error)));
        lods::place_lods(&mut out, &model.document.mesh_nodes, &nodes, &coverages);
    }
    hierarchy::remove_levels(&mut out, &old_levels, nodes.first().copied());
    if let (false, Some(&finest)) = (params.keep_source, nodes.first()) {
        drop_source(&mut out, model, &old_levels, finest);
    }
    out.into_glb()
}

/// `extras` of the node of level `k`, counted from 0.
fn extras(model: &Model, version: &str, k: usize, level: &Level, encoded: &EncodedLevel) -> Value {
    let mut extras = json!({ "simpliguard": {
        "version": version,
        "level": k + 1,
        "budget": level.budget,
        "faces": level.mesh.triangles.len(),
        "error": number(level.error),
        "replaces": model.document.mesh_nodes,
    }});
    if let Some(morphs) = model.surface.morphs.as_ref().filter(|_| encoded.has_morphs()) {
        extras["simpliguard"]["morphs"] = json!(morphs.node);
    }
    if level.keeps_materials() {
        let index = |layer: &LevelLayer| match layer.material {
            LayerMaterial::Source(material) => model.materials.get(material as usize)?.index,
            LayerMaterial::Baked(_) => None,
        };
        extras["simpliguard"]["materials"] = level.layers.iter().map(index).collect();
    }
    extras
}

/// Removes the source's meshes, and everything that only they use. The node `finest` stays in place of lost channels.
fn drop_source(out: &mut Builder, model: &Model, old_levels: &[usize], finest: usize) {
    let mut dropped = old_levels.to_vec();
    dropped.extend(&model.document.mesh_nodes);
    hierarchy::remove_meshes(out, &dropped);
    clips::drop_lost_channels(out, |node| !dropped.contains(&node), finest);
    prune::prune(out, &[Kind::Scene, Kind::Node, Kind::Animation]);
}

/// Encodes the levels in parallel.
fn encode(
    model: &Model,
    levels: &[Level],
    skins: &Skins,
    cancellation: &Cancellation,
) -> Result<Vec<EncodedLevel>, Error> {
    let encode = |(k, level)| EncodedLevel::new(model, level, skins.of(k), cancellation);
    levels.par_iter().enumerate().map(encode).collect()
}

/// The skins of the levels.
struct Skins {
    /// The skin of levels without their own; `None` if no level is skinned.
    shared: Option<Binding>,
    /// For each level, a skin of only the joints that it uses, if it is to have one.
    own: Vec<Option<Binding>>,
}

impl Skins {
    fn new(model: &Model, levels: &[Level]) -> Result<Self, Error> {
        let shared = Binding::new(model, levels)?;
        let own = levels.iter().map(|level| shared.as_ref().and_then(|skin| skin.narrowed(level))).collect();
        Ok(Self { shared, own })
    }

    /// The skin of level `k`.
    fn of(&self, k: usize) -> Option<&Binding> {
        self.own[k].as_ref().or(self.shared.as_ref())
    }

    /// Appends the skins; returns the skin of each level.
    fn write(&self, out: &mut Builder) -> Vec<Option<usize>> {
        let shared = self.shared.as_ref().filter(|_| self.own.iter().any(Option::is_none));
        let shared = shared.map(|skin| skin.write(out));
        self.own.iter().map(|own| own.as_ref().map(|skin| skin.write(out)).or(shared)).collect()
    }
}

/// Appends levels to the document of the source.
struct Writer {
    sampler: usize,
    /// The skin of each level, on the source's joints.
    skins: Vec<Option<usize>>,
    /// Roots of the default scene, and roots above joints outside of it.
    roots: Vec<usize>,
    joints: Vec<usize>,
}

impl Writer {
    /// Appends skins and sampler of `levels` levels.
    fn new(out: &mut Builder, skins: &Skins, levels: usize) -> Self {
        let scene = out.default_scene();
        if let Some(shared) = &skins.shared {
            shared.join_roots(out, scene);
        }
        let joints: Vec<usize> = skins.shared.iter().flat_map(Binding::nodes).collect();
        let roots = hierarchy::with_roots_of(out, hierarchy::scene_roots(out, scene), &joints);
        let skins = skins.write(out);
        let sampler = if levels == 0 { 0 } else { push_sampler(out) };
        Self { sampler, skins, roots, joints }
    }

    /// Appends level `k`, counted from 0, and its scene. Returns the new nodes: first the level, then those of its
    /// scene.
    fn write(&self, out: &mut Builder, k: usize, level: &EncodedLevel, extras: Value) -> Range<usize> {
        let name = format!("LOD{}", k + 1);
        let first = out.all(Kind::Node).len();
        let mesh = level.write(out, &name, self.sampler);
        let skin = self.skins[k].filter(|_| level.is_skinned());
        let mut node = level_node(&name, mesh, skin);
        node["extras"] = extras;
        let node = out.push(Kind::Node, node);
        let scene = match skin {
            Some(skin) => self.scene_nodes(out, &name, mesh, skin),
            None => vec![node],
        };
        out.push(Kind::Scene, json!({ "name": name, "nodes": scene }));
        first..out.all(Kind::Node).len()
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
