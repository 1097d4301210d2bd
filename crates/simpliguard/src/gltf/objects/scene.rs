//! A scene file that is divided into objects, and becomes one file again.

use std::collections::HashMap;

use serde_json::Value;

use super::find::{self, Object};
use super::levels::Levels;
use super::recipe::{Channels, Recipe};
use super::triangles;
use crate::data::NodePattern;
use crate::gltf::export::builder::{Builder, Kind, index};
use crate::gltf::export::embed::embed;
use crate::gltf::export::{clips, hierarchy, prune};
use crate::gltf::import::{ImportLimits, has_levels, read_document};
use crate::{Cancellation, Error, Source};

/// A scene file that is divided into objects.
pub(crate) struct ObjectScene {
    out: Builder,
    /// Nodes that other levels of the file have named.
    old_levels: Vec<usize>,
    /// Each instance, and its kind.
    instances: Vec<(Object, usize)>,
    kinds: Vec<ObjectKind>,
    /// The nodes with meshes.
    mesh_nodes: Vec<usize>,
    /// The levels that stand for all of them.
    whole: Levels,
    pub(crate) has_levels: bool,
}

/// Equal objects.
pub(crate) struct ObjectKind {
    /// The name of the first instance, for messages.
    pub(crate) name: String,
    /// Triangles of one instance.
    pub(crate) faces: u64,
    /// Number of instances.
    pub(crate) instances: u32,
    /// What the caller says of the name. Objects of which it says different things are of different kinds.
    pub(crate) class: u64,
    recipe: Recipe,
    levels: Levels,
    /// The kind whose levels it shows. Two kinds of equal content are found only when their files are built.
    shown: usize,
}

impl ObjectScene {
    /// Reads a file and divides its default scene into objects. `class` tells names apart that must not share their levels.
    ///
    /// # Errors
    /// As [`import`](crate::gltf::import()), but for what the import of an object finds.
    pub(crate) fn read(
        source: &Source<'_>,
        limits: &ImportLimits,
        (patterns, class): (&[NodePattern], impl Fn(&str) -> u64),
        cancellation: &Cancellation,
    ) -> Result<Self, Error> {
        let document = read_document(source, limits, cancellation)?;
        let has_levels = has_levels(&document.json);
        let mut out = embed(source.name, &document)?;
        let mesh_nodes = document.mesh_nodes.clone();
        drop(document);
        let old_levels = hierarchy::remove_lods(&mut out);
        let patterns: Vec<_> = patterns.iter().filter_map(NodePattern::matcher).collect();
        let objects = find::find(&out, &mesh_nodes, &patterns);
        cancellation.check(source.name)?;
        let (channels, mut known) = (Channels::of(&out), HashMap::new());
        let (mut instances, mut kinds) = (Vec::with_capacity(objects.len()), Vec::new());
        for object in objects {
            let recipe = Recipe::new(&out, &object, &channels);
            let name = name_of(&out, &object);
            let class = class(&name);
            let kind = *known.entry((recipe.text(), class)).or_insert_with(|| {
                let faces = object.mesh_nodes.iter().map(|&node| faces(&out, &object, node)).sum();
                let shown = kinds.len();
                kinds.push(ObjectKind { name, faces, instances: 0, class, recipe, levels: Levels::default(), shown });
                kinds.len() - 1
            });
            kinds[kind].instances += 1;
            instances.push((object, kind));
        }
        Ok(Self { out, old_levels, instances, kinds, mesh_nodes, whole: Levels::default(), has_levels })
    }

    /// The kinds of objects, in the order of their first instances.
    pub(crate) fn kinds(&self) -> &[ObjectKind] {
        &self.kinds
    }

    /// The file of a kind: binary glTF with one instance in its own space. Equal objects of other files have equal bytes.
    ///
    /// # Errors
    /// [`Error::Limit`] above 4 GiB.
    pub(crate) fn build(&self, kind: usize) -> Result<Vec<u8>, Error> {
        self.kinds[kind].recipe.build(&self.out)
    }

    /// Takes the levels of a kind out of its baked file.
    ///
    /// # Errors
    /// If the file is none that the export writes.
    pub(crate) fn take_levels(&mut self, kind: usize, glb: &[u8]) -> Result<(), Error> {
        let ObjectKind { name, levels, .. } = &mut self.kinds[kind];
        *levels = Levels::take(&mut self.out, name, glb)?;
        Ok(())
    }

    /// Takes the levels that stand for all objects out of the baked file of the whole scene.
    ///
    /// # Errors
    /// If the file is none that the export writes.
    pub(crate) fn take_whole(&mut self, glb: &[u8]) -> Result<(), Error> {
        self.whole = Levels::take(&mut self.out, "Whole", glb)?;
        Ok(())
    }

    /// Shows the levels of `other`, whose file is the same.
    pub(crate) fn share(&mut self, kind: usize, other: usize) {
        self.kinds[kind].shown = other;
    }

    /// The scene with the levels of all instances, as binary glTF. Without `keep_source`, objects with levels lose their own
    /// meshes.
    ///
    /// # Errors
    /// [`Error::Limit`] above 4 GiB.
    pub(crate) fn finish(mut self, keep_source: bool, version: &str) -> Result<Vec<u8>, Error> {
        self.out.stamp(version);
        let mut replaced = Vec::new();
        let mut finest = None;
        for (object, kind) in &self.instances {
            let levels = &self.kinds[self.kinds[*kind].shown].levels;
            let first = levels.place(&mut self.out, object, version);
            finest = finest.or(first);
            if !levels.is_empty() {
                replaced.extend(&object.mesh_nodes);
            }
        }
        self.whole.place_whole(&mut self.out, &self.mesh_nodes, version);
        if let (false, Some(finest)) = (keep_source, finest) {
            replaced.extend(hierarchy::descendants(&self.out, &self.old_levels));
            replaced.sort_unstable();
            hierarchy::remove_meshes(&mut self.out, &replaced);
            clips::drop_lost_channels(&mut self.out, |node| replaced.binary_search(&node).is_err(), finest);
            prune::prune(&mut self.out, &[Kind::Scene, Kind::Node, Kind::Animation]);
        }
        self.out.into_glb()
    }
}

/// Triangles of a node of an object. Instances that share its only node share its levels.
fn faces(out: &Builder, object: &Object, node: usize) -> u64 {
    match index(&out.all(Kind::Node)[node], "mesh") {
        Some(mesh) if object.nodes.len() == 1 => triangles::of_mesh(out, mesh),
        _ => triangles::of_node(out, node),
    }
}

/// The name of an object: that of its node, else that of its mesh.
fn name_of(out: &Builder, object: &Object) -> String {
    let name = |value: &Value| Some(value.get("name")?.as_str().filter(|name| !name.is_empty())?.to_owned());
    let node = &out.all(Kind::Node)[object.holder];
    let mesh = || name(out.all(Kind::Mesh).get(index(&out.all(Kind::Node)[object.mesh_nodes[0]], "mesh")?)?);
    name(node).or_else(mesh).unwrap_or_else(|| format!("node {}", object.holder))
}
