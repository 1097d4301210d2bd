//! The levels in an output of `bake`, by what their nodes say in `extras.simpliguard`.
//!
//! A level is a set of nodes: one node of a single model, and one for each object of a scene.
//!
//! - `nodes.rs` reads the nodes: which stand in the scene, and whose levels they are.
//! - `part.rs` takes some nodes alone out of a document.

mod nodes;
mod part;

use std::borrow::Cow;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use simpliguard::Error;
use simpliguard::data::Model;

use self::nodes::{LevelNode, Object, has_instances, level_nodes, mesh_nodes, objects_of};
pub(crate) use self::nodes::{below, indices};
pub(crate) use self::part::{Instances, Part, attach};
use crate::inspect::document::{index, triangles_of_mesh, triangles_of_node};

/// What a document shows.
#[derive(Debug, PartialEq)]
pub(crate) struct Levels {
    /// The mesh nodes of the source. Where the file has dropped it, those of its most detailed level.
    pub(crate) source: Vec<usize>,
    /// True if all of these stand in the default scene.
    is_in_scene: bool,
    /// Levels of the whole picture, the smallest first. Levels that stand for all objects come before levels of each object.
    pub(crate) all: Vec<Level>,
    /// The kinds of objects that have levels. Those with the most triangles in the scene come first.
    pub(crate) kinds: Vec<Kind>,
}

/// A level of a document, or of an object.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Level {
    /// `LOD1`, `whole LOD1` or `LOD1 of all objects`.
    pub(crate) name: String,
    /// Its number, from 1, the smallest.
    pub(crate) level: u64,
    pub(crate) budget: Option<u64>,
    pub(crate) faces: Option<u64>,
    /// Distance that 95 % of both surfaces stay within, as a fraction of the diagonal of the source's bounding box.
    pub(crate) error: Option<f64>,
    /// The nodes whose meshes it shows.
    pub(crate) nodes: Vec<usize>,
    pub(crate) of: Of,
}

/// What a level stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Of {
    /// A model, or an object of a scene.
    Model,
    /// All objects of a scene at once.
    Whole,
    /// The objects of a scene, each by a level of its own.
    Objects,
}

impl Of {
    fn name(self, level: u64) -> String {
        match self {
            Self::Model => format!("LOD{level}"),
            Self::Whole => format!("whole LOD{level}"),
            Self::Objects => format!("LOD{level} of all objects"),
        }
    }
}

/// Objects that share their levels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Kind {
    /// The name of the first instance.
    pub(crate) name: String,
    /// Number of instances.
    pub(crate) instances: usize,
    /// Triangles of one instance of the source. `None` if the file has dropped them.
    pub(crate) triangles: Option<u64>,
    /// The mesh nodes of the first instance.
    pub(crate) nodes: Vec<usize>,
    /// How often its levels are drawn.
    pub(crate) drawn: Instances,
    /// The levels of the first instance, the smallest first.
    pub(crate) levels: Vec<Level>,
}

impl Levels {
    /// Reads the nodes of a document. There are no levels if it is no output of `bake`.
    pub(crate) fn of(json: &Value) -> Self {
        let nodes = level_nodes(json);
        let objects = objects_of(json, &nodes);
        let scene = mesh_nodes(json);
        let source = source_of(&scene, &objects);
        let of = |node: &LevelNode| if node.whole { Of::Whole } else { Of::Model };
        let mut all: Vec<Level> =
            nodes.iter().filter(|node| node.object.is_none()).map(|node| node.level(of(node))).collect();
        all.sort_by_key(|level| level.of);
        let most = objects.iter().map(|object| object.levels.len()).max().unwrap_or(0);
        all.extend((1..=most).map(|number| of_objects(json, &source, &objects, number)));
        let is_in_scene = source.len() == scene.len();
        Self { source, is_in_scene, all, kinds: kinds(json, &objects) }
    }

    /// The source in a model that was read from the document: the model itself, unless nodes outside the default scene show
    /// the source.
    ///
    /// # Errors
    /// Those of the import.
    pub(crate) fn source_of<'m>(&self, model: &'m Model) -> Result<Cow<'m, Model>, Error> {
        if self.is_in_scene {
            return Ok(Cow::Borrowed(model));
        }
        let part = Part { document: &model.document, nodes: &self.source, drawn: Instances::All };
        part.import(&model.name).map(Cow::Owned)
    }
}

/// The nodes that show the source: those of the scene, and the finest level of each object whose own meshes are gone.
fn source_of(scene: &BTreeSet<usize>, objects: &[Object<'_>]) -> Vec<usize> {
    let gone = objects.iter().filter(|object| !object.replaces.iter().any(|node| scene.contains(node)));
    let finest = gone.filter_map(|object| object.levels.last()).map(|level| level.node);
    scene.iter().copied().chain(finest).collect::<BTreeSet<_>>().into_iter().collect()
}

/// The level that shows each object by its level of this number. What has no such level is shown as in the source.
fn of_objects(json: &Value, source: &[usize], objects: &[Object<'_>], number: usize) -> Level {
    let mut nodes: BTreeSet<usize> = source.iter().copied().collect();
    for object in objects {
        if let Some(level) = object.levels.get(number - 1) {
            for replaced in object.replaces.iter().chain(object.levels.last().map(|finest| &finest.node)) {
                nodes.remove(replaced);
            }
            nodes.insert(level.node);
        }
    }
    Level {
        name: Of::Objects.name(number as u64),
        level: number as u64,
        budget: None,
        faces: Some(nodes.iter().map(|&node| triangles_of_node(json, node)).sum()),
        error: None,
        nodes: nodes.into_iter().collect(),
        of: Of::Objects,
    }
}

/// Objects whose levels show the same meshes are of one kind.
fn kinds(json: &Value, objects: &[Object<'_>]) -> Vec<Kind> {
    let (mut kinds, mut known) = (Vec::<Kind>::new(), BTreeMap::new());
    for object in objects {
        let meshes: Vec<_> = object.levels.iter().map(|level| level.mesh).collect();
        let kind = *known.entry(meshes).or_insert(kinds.len());
        match kinds.get_mut(kind) {
            Some(kind) => kind.instances += 1,
            None => kinds.push(Kind::of(json, object)),
        }
    }
    kinds.sort_by_key(|kind| Reverse(kind.all_triangles()));
    kinds
}

impl Kind {
    /// Triangles of all instances; of their finest level if the file has dropped the source.
    fn all_triangles(&self) -> u64 {
        let finest = || self.levels.last().and_then(|level| level.faces);
        self.triangles.or_else(finest).unwrap_or(0) * self.instances as u64
    }

    fn of(json: &Value, first: &Object<'_>) -> Self {
        let name = |value: &Value| Some(value.get("name")?.as_str().filter(|name| !name.is_empty())?.to_owned());
        let node = |node: usize| json.get("nodes")?.get(node);
        let meshes = || first.replaces.iter().filter_map(|&replaced| index(node(replaced)?, "mesh"));
        let of_mesh = || name(json.get("meshes")?.get(meshes().next()?)?);
        let drawn = match first.levels.first() {
            Some(level) if has_instances(json, level.node) => Instances::One,
            _ => Instances::All,
        };
        let triangles = match drawn {
            Instances::One => meshes().map(|mesh| triangles_of_mesh(json, mesh)).sum(),
            Instances::All => first.replaces.iter().map(|&node| triangles_of_node(json, node)).sum(),
        };
        Self {
            name: node(first.holder)
                .and_then(name)
                .or_else(of_mesh)
                .unwrap_or_else(|| format!("node {}", first.holder)),
            instances: 1,
            triangles: Some(triangles).filter(|&triangles| triangles > 0),
            nodes: first.replaces.clone(),
            drawn,
            levels: first.levels.iter().map(|level| level.level(Of::Model)).collect(),
        }
    }
}

impl LevelNode {
    /// The level that this node is alone.
    fn level(&self, of: Of) -> Level {
        let Self { level, budget, faces, error, node, .. } = *self;
        Level { name: of.name(level), level, budget, faces, error, nodes: vec![node], of }
    }
}

#[cfg(test)]
mod tests;
