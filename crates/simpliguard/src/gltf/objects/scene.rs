//! A scene file that is divided into objects, and becomes one file again.

use std::collections::HashMap;

use serde_json::Value;

use super::find::{self, Object};
use super::levels::Levels;
use super::own_levels::{OwnLevel, OwnLevels};
use super::recipe::{Channels, Recipe};
use super::shared_atlas::SharedAtlas;
use crate::data::{NodePattern, TextureFormat};
use crate::gltf::authored::level_nodes;
use crate::gltf::export::builder::{Builder, Kind, index};
use crate::gltf::export::embed::embed;
use crate::gltf::export::{clips, hierarchy, lods, prune};
use crate::gltf::import::{ImportLimits, read_document};
use crate::gltf::triangles;
use crate::{Cancellation, Error, Source};

/// A scene file that is divided into objects.
#[derive(Clone)]
pub(crate) struct ObjectScene {
    out: Builder,
    /// The nodes of the levels that the file came with, and those that `MSFT_lod` listed.
    old_levels: Vec<usize>,
    /// Each instance, and its kind.
    instances: Vec<(Object, usize)>,
    kinds: Vec<ObjectKind>,
    /// The nodes with meshes.
    mesh_nodes: Vec<usize>,
    /// The levels that stand for all of them.
    whole: Levels,
    /// The textures that the smallest levels of all objects share, if they do.
    atlas: Option<SharedAtlas>,
    /// True for an output of a bake.
    pub(crate) is_baked: bool,
    /// Number of levels of the file that are of no use: those of no object, or of several meshes.
    pub(crate) levels_left_out: usize,
}

/// Equal objects.
#[derive(Clone)]
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
    /// The levels that the first instance came with, in falling detail, and those of them that are used, with their errors.
    own: Vec<OwnLevel>,
    used: Vec<(OwnLevel, f32)>,
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
        let mut out = embed(source.name, &document)?;
        let mesh_nodes = document.mesh_nodes.clone();
        drop(document);
        let is_baked = remove_stamps(&mut out);
        let mut own_levels = OwnLevels::of(&out, &mesh_nodes);
        let mut old_levels: Vec<usize> = level_nodes(out.all(Kind::Node)).into_iter().collect();
        old_levels.extend(lods::remove_lods(&mut out));
        let patterns: Vec<_> = patterns.iter().filter_map(NodePattern::matcher).collect();
        let objects = find::find(&out, &mesh_nodes, &patterns);
        cancellation.check(source.name)?;
        let (channels, mut known) = (Channels::of(&out), HashMap::new());
        let (mut instances, mut kinds) = (Vec::with_capacity(objects.len()), Vec::new());
        for object in objects {
            let recipe = Recipe::new(&out, &object, &channels);
            let name = name_of(&out, &object);
            let class = class(&name);
            let own = own_levels.take(&out, &object);
            let kind = *known.entry((recipe.text(), class, own.clone())).or_insert_with(|| {
                let faces = object.mesh_nodes.iter().map(|&node| faces(&out, &object, node)).sum();
                kinds.push(ObjectKind { own, ..ObjectKind::new(name, faces, class, recipe, kinds.len()) });
                kinds.len() - 1
            });
            kinds[kind].instances += 1;
            instances.push((object, kind));
        }
        let (whole, atlas, levels_left_out) = (Levels::default(), None, own_levels.left_out);
        Ok(Self { out, old_levels, instances, kinds, mesh_nodes, whole, atlas, is_baked, levels_left_out })
    }

    /// Lets the smallest levels of all objects share textures of at most `side` texels a side, a power of two. Levels that
    /// objects came with keep theirs.
    pub(crate) fn share_textures(&mut self, side: u32, format: TextureFormat) {
        self.atlas = Some(SharedAtlas::new(side, format));
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

    /// The files of the levels that a kind came with, in falling detail: each in place of the object's meshes.
    ///
    /// # Errors
    /// [`Error::Limit`] above 4 GiB.
    pub(crate) fn build_own_levels(&self, kind: usize) -> Result<Vec<Vec<u8>>, Error> {
        let ObjectKind { recipe, own, .. } = &self.kinds[kind];
        own.iter().map(|level| level.recipe(recipe).build(&self.out)).collect()
    }

    /// Uses the levels that a kind came with: those that have an error, a fraction of the diagonal of the object's bounding box.
    pub(crate) fn use_own_levels(&mut self, kind: usize, errors: &[Option<f32>]) {
        let ObjectKind { own, used, instances, .. } = &mut self.kinds[kind];
        *used = own.drain(..).zip(errors).filter_map(|(level, error)| Some((level, (*error)?))).collect();
        self.levels_left_out += errors.iter().filter(|error| error.is_none()).count() * *instances as usize;
    }

    /// Takes the levels of a kind out of its baked file.
    ///
    /// # Errors
    /// If the file is none that the export writes.
    pub(crate) fn take_levels(&mut self, kind: usize, glb: &[u8]) -> Result<(), Error> {
        let ObjectKind { name, levels, recipe, .. } = &mut self.kinds[kind];
        let materials = recipe.materials(&self.out);
        *levels = Levels::take(&mut self.out, name, glb, &materials, self.atlas.as_mut())?;
        Ok(())
    }

    /// Takes the levels that stand for all objects out of the baked file of the whole scene.
    ///
    /// # Errors
    /// If the file is none that the export writes.
    pub(crate) fn take_whole(&mut self, glb: &[u8]) -> Result<(), Error> {
        // They have materials of their own.
        self.whole = Levels::take(&mut self.out, "Whole", glb, &HashMap::new(), None)?;
        Ok(())
    }

    /// Shows the levels of `other`, whose file is the same.
    pub(crate) fn share(&mut self, kind: usize, other: usize) {
        self.kinds[kind].shown = other;
    }

    /// Writes the textures that levels share. Returns their side in texels; `None` if there are none.
    ///
    /// # Errors
    /// If a texture of a level cannot be read, and the error of a bake that was cancelled.
    pub(crate) fn write_shared_textures(&mut self, cancellation: &Cancellation) -> Result<Option<u32>, Error> {
        self.atlas.take().map_or(Ok(None), |atlas| atlas.write(&mut self.out, cancellation))
    }

    /// The scene with the levels of all instances, as binary glTF. Without `keep_source`, objects with levels lose their own
    /// meshes.
    ///
    /// # Errors
    /// [`Error::Limit`] above 4 GiB.
    pub(crate) fn finish(mut self, keep_source: bool, version: &str) -> Result<Vec<u8>, Error> {
        self.out.stamp(version);
        for ObjectKind { levels, recipe, used, .. } in &mut self.kinds {
            levels.add_own(recipe, used);
        }
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
        hierarchy::remove_levels(&mut self.out, &self.old_levels, finest);
        if let (false, Some(finest)) = (keep_source, finest) {
            replaced.extend(&self.old_levels);
            replaced.sort_unstable();
            hierarchy::remove_meshes(&mut self.out, &replaced);
            clips::drop_lost_channels(&mut self.out, |node| replaced.binary_search(&node).is_err(), finest);
            prune::prune(&mut self.out, &[Kind::Scene, Kind::Node, Kind::Animation]);
        }
        self.out.into_glb()
    }
}

impl ObjectKind {
    fn new(name: String, faces: u64, class: u64, recipe: Recipe, shown: usize) -> Self {
        let (instances, levels, own, used) = (0, Levels::default(), Vec::new(), Vec::new());
        Self { name, faces, instances, class, recipe, levels, own, used, shown }
    }

    /// Triangles and errors of the levels that it came with and uses, in falling detail.
    pub(crate) fn own_levels(&self) -> impl Iterator<Item = (u64, f32)> {
        self.used.iter().map(|(level, error)| (level.faces, *error))
    }
}

/// Removes what earlier bakes have written to nodes. Returns whether there was anything.
fn remove_stamps(out: &mut Builder) -> bool {
    let stamp = |node: &mut Value| node.get_mut("extras")?.as_object_mut()?.remove("simpliguard");
    out.all_mut(Kind::Node).iter_mut().filter_map(stamp).count() > 0
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
