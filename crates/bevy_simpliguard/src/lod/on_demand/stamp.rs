//! The description of a file's source and levels on demand, in `extras` of its asset.

use bevy::asset::{AssetPath, LoadContext};
use bevy::gltf::GltfAssetLabel;
use bevy::platform::collections::HashSet;
use bevy::prelude::*;
use gltf::json::deserialize;
use serde::Deserialize;

use super::asset_source::SOURCE;
use super::components::{OnDemand, OnDemandPart};

#[derive(Deserialize)]
struct Extras {
    simpliguard: Stamp,
}

#[derive(Deserialize)]
struct Stamp {
    source: Option<PartStamp>,
    #[serde(default)]
    levels: Vec<PartStamp>,
    /// The part that a file has, if it is not the smallest levels.
    part: Option<Kind>,
}

#[derive(Clone, Debug, Deserialize)]
struct PartStamp {
    #[serde(default)]
    level: u32,
    /// The name of its file.
    file: String,
    /// Bytes on the GPU.
    bytes: u64,
    meshes: Vec<usize>,
    /// Triangles of each primitive of each mesh.
    #[serde(default)]
    faces: Vec<Vec<u32>>,
    textures: Vec<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Source,
    Level,
}

/// The parts of a file that are loaded on demand: the source, and levels.
#[derive(Clone, Debug)]
pub(in crate::lod) struct PartsOfFile(Vec<PartOfFile>);

#[derive(Clone, Debug)]
struct PartOfFile {
    stamp: PartStamp,
    /// The nodes that show it.
    nodes: Vec<usize>,
    /// The labels of its meshes.
    meshes: Vec<String>,
}

fn stamp(document: &gltf::Document) -> Option<Stamp> {
    let extras = document.as_json().asset.extras.as_ref()?;
    Some(deserialize::from_str::<Extras>(extras.get()).ok()?.simpliguard)
}

/// Tells whether a file is a part of a model that is in another file.
pub(in crate::lod) fn is_part(document: &gltf::Document) -> bool {
    stamp(document).is_some_and(|stamp| stamp.part.is_some())
}

impl PartsOfFile {
    /// The parts of a file that are loaded on demand. `None` if there are none.
    pub(in crate::lod) fn of(document: &gltf::Document) -> Option<Self> {
        let Stamp { source, levels, .. } = stamp(document)?;
        let parts = source.into_iter().chain(levels).map(|stamp| PartOfFile::of(document, stamp));
        let parts: Vec<PartOfFile> = parts.filter(|part| !part.meshes.is_empty()).collect();
        (!parts.is_empty()).then_some(Self(parts))
    }

    /// Tells whether a mesh is a placeholder in the file.
    pub(in crate::lod) fn has(&self, mesh: usize) -> bool {
        self.0.iter().any(|part| part.stamp.meshes.contains(&mesh))
    }

    /// The triangles of each primitive of a mesh that is a placeholder in the file. `None` for others.
    pub(in crate::lod) fn faces(&self, mesh: usize) -> Option<&[u32]> {
        self.0.iter().find_map(|PartOfFile { stamp, .. }| {
            let place = stamp.meshes.iter().position(|own| *own == mesh)?;
            Some(stamp.faces.get(place)?.as_slice())
        })
    }

    /// The component of a scene with these nodes. `None` if neither its nodes nor levels that stand for them show a part.
    /// `has_levels` tells whether levels stand for all that the scene has of the source.
    pub(in crate::lod) fn component(
        &self,
        context: &mut LoadContext<'_>,
        rotate_meshes: bool,
        nodes: &HashSet<usize>,
        has_levels: bool,
    ) -> Option<OnDemand> {
        let is_in_scene = |part: &PartOfFile| part.nodes.iter().any(|node| nodes.contains(node));
        let has_source = self.0.iter().any(|part| part.is_source() && is_in_scene(part));
        let parts = self.0.iter().filter(|part| has_source || is_in_scene(part));
        let always = |part: &PartOfFile| is_in_scene(part) && !(part.is_source() && has_levels);
        let parts: Vec<OnDemandPart> = parts.map(|part| part.component(context, always(part))).collect();
        (!parts.is_empty()).then_some(OnDemand { parts, rotate_meshes })
    }
}

impl PartOfFile {
    fn of(document: &gltf::Document, stamp: PartStamp) -> Self {
        let is_own = |mesh: &gltf::Mesh<'_>| stamp.meshes.contains(&mesh.index());
        let shows = |node: &gltf::Node<'_>| node.mesh().is_some_and(|mesh| is_own(&mesh));
        let nodes = document.nodes().filter(shows).map(|node| node.index()).collect();
        let labels = |mesh: gltf::Mesh<'_>| {
            let label = |primitive| GltfAssetLabel::Primitive { mesh: mesh.index(), primitive }.to_string();
            (0..mesh.primitives().len()).map(label).collect::<Vec<_>>()
        };
        let meshes = document.meshes().filter(is_own).flat_map(labels).collect();
        Self { stamp, nodes, meshes }
    }

    fn is_source(&self) -> bool {
        self.stamp.level == 0
    }

    fn component(&self, context: &mut LoadContext<'_>, always: bool) -> OnDemandPart {
        let path = context.path().path().join(&self.stamp.file);
        let file = AssetPath::from(path).with_source(SOURCE).to_string();
        let meshes = self.meshes.iter().map(|label| context.get_label_handle(label.clone())).collect();
        let texture = |&texture: &usize| context.get_label_handle(GltfAssetLabel::Texture(texture).to_string());
        let textures = self.stamp.textures.iter().map(texture).collect();
        OnDemandPart { level: self.stamp.level, file, bytes: self.stamp.bytes, meshes, textures, always }
    }
}
