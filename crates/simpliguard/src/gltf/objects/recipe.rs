//! The description of an object without its place in the scene.

use std::collections::{BTreeMap, HashMap};

use serde_json::{Map, Value, json};

use super::copy::Copier;
use super::find::Object;
use crate::Error;
use crate::gltf::export::builder::{Builder, Kind, index, indices};
use crate::gltf::export::hierarchy::TRANSFORM;
use crate::gltf::export::prune::retain_used_extensions;

/// The extension of instances that share a node.
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// An object as a document of its own. Nodes and skins have its own indices; meshes and accessors are those of the scene.
/// So equal recipes in one scene are equal objects.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Recipe {
    nodes: Vec<Value>,
    roots: Vec<usize>,
    skins: Vec<Value>,
    animations: Vec<Value>,
}

/// The channels of all clips, by the nodes they move: index of the clip and of the channel.
pub(super) struct Channels(HashMap<usize, Vec<(usize, usize)>>);

impl Channels {
    pub(super) fn of(out: &Builder) -> Self {
        let mut by_node: HashMap<usize, Vec<(usize, usize)>> = HashMap::new();
        for (clip, animation) in out.all(Kind::Animation).iter().enumerate() {
            let channels = animation.get("channels").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
            for (channel, node) in
                channels.iter().enumerate().filter_map(|(c, v)| Some((c, index(v.get("target")?, "node")?)))
            {
                by_node.entry(node).or_default().push((clip, channel));
            }
        }
        Self(by_node)
    }
}

impl Recipe {
    /// Describes an object.
    pub(super) fn new(out: &Builder, object: &Object, channels: &Channels) -> Self {
        let local: HashMap<usize, usize> = object.nodes.iter().enumerate().map(|(i, &node)| (node, i)).collect();
        let mut skins = Vec::new();
        let nodes: Vec<Value> =
            object.nodes.iter().map(|&node| describe(out, object, node, &local, &mut skins)).collect();
        let skins = skins.iter().map(|&skin| describe_skin(out, skin, &local)).collect();
        let children: Vec<usize> = nodes.iter().flat_map(|node| indices(node, "children")).collect();
        let roots = (0..nodes.len()).filter(|node| !children.contains(node)).collect();
        Self { nodes, roots, skins, animations: describe_clips(out, object, channels, &local) }
    }

    /// The recipe as text: equal texts are equal recipes.
    pub(super) fn text(&self) -> String {
        json!([self.nodes, self.roots, self.skins, self.animations]).to_string()
    }

    /// The object with one mesh in place of all others, on one of its nodes, and without clips. The node keeps its skin.
    pub(super) fn with_mesh(&self, node: usize, mesh: usize) -> Self {
        let mut recipe = Self { animations: Vec::new(), ..self.clone() };
        for (i, members) in recipe.nodes.iter_mut().enumerate().filter_map(|(i, node)| Some((i, node.as_object_mut()?)))
        {
            ["mesh", "weights", "extensions"].iter().for_each(|key| drop(members.remove(*key)));
            if i == node {
                members.insert("mesh".into(), json!(mesh));
            } else {
                members.remove("skin");
            }
        }
        recipe
    }

    /// The skin of a node.
    pub(super) fn skin_of(&self, node: usize) -> Option<&Value> {
        self.skins.get(index(self.nodes.get(node)?, "skin")?)
    }

    /// The object as binary glTF.
    pub(super) fn build(&self, scene: &Builder) -> Result<Vec<u8>, Error> {
        self.copy(scene).0.into_glb()
    }

    /// The material of the scene for each material of the object's file.
    pub(super) fn materials(&self, scene: &Builder) -> HashMap<usize, usize> {
        self.copy(scene).1.materials().map(|(of_scene, of_object)| (of_object, of_scene)).collect()
    }

    /// The object's document, and what was copied into it.
    fn copy(&self, scene: &Builder) -> (Builder, Copier) {
        let (mut out, mut copier) = (Builder::new(&scene.asset), Copier::new(true));
        for list in ["extensionsUsed", "extensionsRequired"] {
            let names = scene.json.get(list).and_then(Value::as_array).into_iter().flatten();
            let mut names: Vec<&str> = names.filter_map(Value::as_str).collect();
            names.sort_unstable();
            names.dedup();
            out.json.insert(list.into(), json!(names));
        }
        out.json.insert("scene".into(), json!(0));
        out.push(Kind::Scene, json!({ "nodes": self.roots }));
        let all = [(Kind::Node, &self.nodes), (Kind::Skin, &self.skins), (Kind::Animation, &self.animations)];
        for (kind, object) in all.into_iter().flat_map(|(kind, objects)| objects.iter().map(move |o| (kind, o))) {
            let mut object = object.clone();
            copier.copy_references(scene, &mut out, kind, &mut object);
            out.push(kind, object);
        }
        retain_used_extensions(&mut out);
        (out, copier)
    }
}

/// A node without name, and without a transform if the object is described in its space.
fn describe(
    out: &Builder,
    object: &Object,
    node: usize,
    local: &HashMap<usize, usize>,
    skins: &mut Vec<usize>,
) -> Value {
    let source = &out.all(Kind::Node)[node];
    let is_anchor = Some(node) == object.anchor;
    let mut members = Map::new();
    let mut keep = |key: &str| members.extend(source.get(key).map(|value| (key.to_owned(), value.clone())));
    if !is_anchor {
        TRANSFORM.iter().for_each(|key| keep(key));
    }
    let has_mesh = object.mesh_nodes.binary_search(&node).is_ok();
    if has_mesh {
        ["mesh", "weights"].iter().for_each(|key| keep(key));
    }
    if let Some(skin) = index(source, "skin").filter(|_| has_mesh) {
        let known = skins.iter().position(|known| *known == skin);
        members.insert("skin".into(), json!(known.unwrap_or(skins.len())));
        skins.extend(known.is_none().then_some(skin));
    }
    // All instances of a single node share its levels.
    let instancing = source.get("extensions").and_then(|extensions| extensions.get(INSTANCING));
    if let Some(instancing) = instancing.filter(|_| has_mesh && !(is_anchor && object.nodes.len() == 1)) {
        members.insert("extensions".into(), json!({ INSTANCING: instancing }));
    }
    let children: Vec<usize> = indices(source, "children").filter_map(|child| local.get(&child).copied()).collect();
    if !children.is_empty() {
        members.insert("children".into(), json!(children));
    }
    Value::Object(members)
}

fn describe_skin(out: &Builder, skin: usize, local: &HashMap<usize, usize>) -> Value {
    let Some(source) = out.all(Kind::Skin).get(skin) else { return json!({ "joints": [] }) };
    // A joint outside of the scene has no place here either, and the import refuses it.
    let joints: Vec<usize> =
        indices(source, "joints").map(|joint| local.get(&joint).copied().unwrap_or(usize::from(u16::MAX))).collect();
    let mut skin = json!({ "joints": joints });
    if let Some(matrices) = source.get("inverseBindMatrices") {
        skin["inverseBindMatrices"] = matrices.clone();
    }
    skin
}

/// The clips that move the object in its own space, without names.
fn describe_clips(out: &Builder, object: &Object, channels: &Channels, local: &HashMap<usize, usize>) -> Vec<Value> {
    let mut by_clip: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (clip, channel) in object.nodes.iter().filter_map(|node| channels.0.get(node)).flatten() {
        by_clip.entry(*clip).or_default().push(*channel);
    }
    by_clip.into_iter().filter_map(|(clip, kept)| describe_clip(out, object, (clip, kept), local)).collect()
}

fn describe_clip(
    out: &Builder,
    object: &Object,
    (clip, mut kept): (usize, Vec<usize>),
    local: &HashMap<usize, usize>,
) -> Option<Value> {
    kept.sort_unstable();
    let clip = &out.all(Kind::Animation)[clip];
    let (mut channels, mut samplers) = (Vec::new(), Vec::new());
    for channel in kept {
        let channel = clip.get("channels")?.get(channel)?;
        let target = channel.get("target")?;
        let (node, path) = (index(target, "node")?, target.get("path")?.as_str()?);
        let counts = match path {
            "weights" => object.mesh_nodes.binary_search(&node).is_ok(),
            "translation" | "rotation" | "scale" => Some(node) != object.anchor,
            _ => false,
        };
        let Some(sampler) = clip.get("samplers")?.get(index(channel, "sampler")?).filter(|_| counts) else { continue };
        let mut sampler = sampler.clone();
        sampler.as_object_mut()?.retain(|key, _| ["input", "output", "interpolation"].contains(&key.as_str()));
        channels.push(json!({ "sampler": samplers.len(), "target": { "node": local.get(&node)?, "path": path } }));
        samplers.push(sampler);
    }
    (!channels.is_empty()).then(|| json!({ "channels": channels, "samplers": samplers }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Builder {
        let mut out = Builder::new("test");
        out.json.insert(
            "nodes".into(),
            json!([
                { "name": "a", "mesh": 3, "translation": [1, 2, 3], "extras": 1 },
                { "name": "b", "mesh": 3, "scale": [-1, 1, 1], "extensions": { INSTANCING: { "attributes": {} } } },
                { "mesh": 3, "weights": [0.5], "children": [3] },
                { "mesh": 4, "translation": [1, 0, 0] },
            ]),
        );
        let channel = |node: usize, path: &str| json!({ "sampler": 0, "target": { "node": node, "path": path } });
        let moves = [channel(0, "translation"), channel(2, "weights"), channel(3, "rotation"), channel(2, "rotation")];
        out.push(
            Kind::Animation,
            json!({ "name": "c", "channels": moves, "samplers": [{ "input": 7, "output": 8, "extras": 0 }] }),
        );
        out
    }

    fn recipe(mesh_nodes: &[usize]) -> Recipe {
        let (scene, anchor) = (scene(), mesh_nodes[0]);
        let object = Object {
            holder: anchor,
            anchor: Some(anchor),
            nodes: mesh_nodes.to_vec(),
            mesh_nodes: mesh_nodes.to_vec(),
            owns_subtree: true,
        };
        Recipe::new(&scene, &object, &Channels::of(&scene))
    }

    #[test]
    fn neither_place_nor_name_nor_mirroring_makes_a_difference() {
        let expected = Recipe { nodes: vec![json!({ "mesh": 3 })], roots: vec![0], skins: vec![], animations: vec![] };
        assert_eq!((recipe(&[0]), recipe(&[1])), (expected.clone(), expected));
        assert_eq!(recipe(&[3]).nodes, [json!({ "mesh": 4 })]);
    }

    #[test]
    fn what_moves_within_an_object_is_part_of_it() {
        let recipe = recipe(&[2, 3]);
        let nodes =
            [json!({ "mesh": 3, "weights": [0.5], "children": [1] }), json!({ "mesh": 4, "translation": [1, 0, 0] })];
        assert_eq!((&recipe.nodes[..], &recipe.roots[..]), (&nodes[..], &[0][..]));
        let sampler = json!({ "input": 7, "output": 8 });
        let channels = json!([
            { "sampler": 0, "target": { "node": 0, "path": "weights" } },
            { "sampler": 1, "target": { "node": 1, "path": "rotation" } },
        ]);
        assert_eq!(recipe.animations, [json!({ "channels": channels, "samplers": [sampler.clone(), sampler] })]);
    }
}
